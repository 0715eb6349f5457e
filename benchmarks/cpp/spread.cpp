// The task `spread` (src/gamekeeper/envs/spread.py) in C++: the same arrays written by a step of a batch, the same
// checks of actions, the same seeds and new episodes (same_step), the same bits.
//
//   g++ -O3 -march=native -ffp-contract=off spread.cpp -o spread
//   ./spread 1024 2.0    agent-steps a second of 1,024 copies, best of 5 parts of 2 seconds, as a JSON line
//   ./spread 64 check    sums of what 64 copies show and pay in 1,000 steps, to compare with ours

#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>

constexpr int N = 3, OBS = 4 + 2 * N + 4 * (N - 1), HORIZON = 25;
constexpr double DT = 0.1, KEPT = 0.75, FORCE = 1e2, MARGIN = 1e-3, STRENGTH = 5.0, SIZE = 0.15, RATIO = 0.5,
                 CLOSE = 0.038, TOUCHING = 0.08999999999999998;
constexpr uint64_t WORD = 0xffffffffu;

struct Copy {
    int64_t seed, draws, block, number, time;
    uint32_t words[4];
    int8_t live[N], ending[N];
    double x[N], y[N], vx[N], vy[N], fx[N], fy[N], mark_x[N], mark_y[N];
};

struct Batch {
    int envs;
    uint64_t pool, constant;
    std::vector<Copy> copies;
    std::vector<float> obs, last_obs;
    std::vector<double> rewards, terms;
    std::vector<uint8_t> terminated, truncated, live, last, over, ended;
};

static uint32_t episode_seed(uint64_t pool, uint64_t constant, uint64_t episode) {
    constexpr uint64_t INIT_B = 0x8b51f9dd, MULT_A = 0x931e8875, MULT_B = 0x58f38ded, MIX_R = 0x4973f715;
    uint64_t value = ((episode ^ constant) * (constant * MULT_A & WORD)) & WORD;
    value = (pool - (MIX_R * (value ^ (value >> 16)) & WORD)) & WORD;
    value = (((value ^ (value >> 16)) ^ INIT_B) * (INIT_B * MULT_B & WORD)) & WORD;
    return uint32_t((value ^ (value >> 16)) >> 1);
}

static uint32_t word(Copy& s) {  // Philox4x32-10 of (seed, draw)
    const int64_t drawn = s.draws++, block = drawn >> 2;
    if (block != s.block) {
        uint32_t c0 = uint32_t(block), c1 = uint32_t(uint64_t(block) >> 32), c2 = 0, c3 = 0;
        uint32_t k0 = uint32_t(s.seed), k1 = uint32_t(uint64_t(s.seed) >> 32);
        for (int round = 0; round < 10; round++) {
            const uint64_t p0 = uint64_t(0xD2511F53u) * c0, p1 = uint64_t(0xCD9E8D57u) * c2;
            const uint32_t d0 = uint32_t(p1 >> 32) ^ c1 ^ k0, d2 = uint32_t(p0 >> 32) ^ c3 ^ k1;
            c0 = d0, c1 = uint32_t(p1), c2 = d2, c3 = uint32_t(p0);
            k0 += 0x9E3779B9u, k1 += 0xBB67AE85u;
        }
        s.words[0] = c0, s.words[1] = c1, s.words[2] = c2, s.words[3] = c3, s.block = block;
    }
    return s.words[drawn & 3];
}

static double uniform(Copy& s) {
    const uint64_t first = word(s), second = word(s);
    return -1.0 + 2.0 * (double((first >> 5) * 67108864 + (second >> 6)) * (1.0 / 9007199254740992.0));
}

static double penetration(double gap) {
    const double z = -gap / MARGIN;
    return (z > 0.0 ? z + std::log1p(std::exp(-z)) : std::log1p(std::exp(z))) * MARGIN;
}

static void play(Copy& s, const int64_t* actions, double* terms) {
    for (int i = 0; i < N; i++) {
        s.fx[i] = STRENGTH * ((actions[i] == 2) - (actions[i] == 1));
        s.fy[i] = STRENGTH * ((actions[i] == 4) - (actions[i] == 3));
    }
    for (int i = 0; i < N; i++)
        for (int j = i + 1; j < N; j++) {
            const double dx = s.x[i] - s.x[j], dy = s.y[i] - s.y[j], square = dx * dx + dy * dy;
            if (square > (2 * SIZE + CLOSE) * (2 * SIZE + CLOSE) || square == 0.0) continue;
            const double distance = std::sqrt(square), depth = penetration(distance - 2 * SIZE);
            const double fx = FORCE * dx / distance * depth, fy = FORCE * dy / distance * depth;
            s.fx[i] += fx, s.fy[i] += fy, s.fx[j] -= fx, s.fy[j] -= fy;
        }
    for (int i = 0; i < N; i++) {
        s.x[i] += s.vx[i] * DT, s.y[i] += s.vy[i] * DT;
        s.vx[i] = s.vx[i] * KEPT + s.fx[i] * DT, s.vy[i] = s.vy[i] * KEPT + s.fy[i] * DT;
    }
    double far = 0.0;
    for (int k = 0; k < N; k++) {
        double best = INFINITY;
        for (int i = 0; i < N; i++) {
            const double dx = s.x[i] - s.mark_x[k], dy = s.y[i] - s.mark_y[k];
            best = std::fmin(best, dx * dx + dy * dy);
        }
        far -= std::sqrt(best);
    }
    far *= 1 - RATIO;
    for (int i = 0; i < N; i++)
        for (int j = i + 1; j < N; j++) {
            const double dx = s.x[i] - s.x[j], dy = s.y[i] - s.y[j];
            if (dx * dx + dy * dy < TOUCHING) terms[2 * i + 1] -= 1.0, terms[2 * j + 1] -= 1.0;
        }
    for (int i = 0; i < N; i++) terms[2 * i] = far, terms[2 * i + 1] *= RATIO;
}

static void observe(const Copy& s, float* obs) {
    for (int i = 0; i < N; i++, obs += OBS) {
        obs[0] = float(s.vx[i]), obs[1] = float(s.vy[i]), obs[2] = float(s.x[i]), obs[3] = float(s.y[i]);
        int at = 4;
        for (int k = 0; k < N; k++, at += 2)
            obs[at] = float(s.mark_x[k] - s.x[i]), obs[at + 1] = float(s.mark_y[k] - s.y[i]);
        for (int j = 0; j < N; j++)
            if (j != i) obs[at] = float(s.x[j] - s.x[i]), obs[at + 1] = float(s.y[j] - s.y[i]), at += 2;
        for (; at < OBS; at++) obs[at] = 0.0f;
    }
}

static void begin(Batch& b, int e) {
    Copy& s = b.copies[e];
    const int64_t number = s.number;
    std::memset(&s, 0, sizeof s);
    s.number = number, s.seed = episode_seed(b.pool, b.constant, uint64_t(number)), s.block = -1;
    for (int i = 0; i < N; i++) s.live[i] = 1;
    for (int i = 0; i < N; i++) s.x[i] = uniform(s), s.y[i] = uniform(s);
    for (int i = 0; i < N; i++) s.mark_x[i] = uniform(s), s.mark_y[i] = uniform(s);
    for (int i = 0; i < N; i++) b.live[e * N + i] = 1;
    observe(s, &b.obs[size_t(e) * N * OBS]);
}

static bool step(Batch& b, const int64_t* actions) {
    for (int e = 0; e < b.envs; e++)
        for (int i = 0; i < N; i++)
            if (b.live[e * N + i] && (actions[e * N + i] < 0 || actions[e * N + i] >= 5)) return false;
    for (int e = 0; e < b.envs; e++) {
        Copy& s = b.copies[e];
        double *rewards = &b.rewards[e * N], *terms = &b.terms[e * N * 2];
        uint8_t *terminated = &b.terminated[e * N], *truncated = &b.truncated[e * N], *live = &b.live[e * N];
        for (int i = 0; i < N; i++) terminated[i] = truncated[i] = 0, terms[2 * i] = terms[2 * i + 1] = 0.0;
        s.time++;
        play(s, actions + e * N, terms);
        int left = 0;
        for (int i = 0; i < N; i++) {
            if (s.live[i] && s.time >= HORIZON) truncated[i] = 1, s.ending[i] = -1, s.live[i] = 0;
            left += s.live[i];
            rewards[i] = terms[2 * i] + terms[2 * i + 1];
        }
        b.ended[e] = left == 0;
        if (left == 0) {
            for (int i = 0; i < N; i++) b.last[e * N + i] = 1;
            observe(s, &b.last_obs[size_t(e) * N * OBS]);
            s.number += b.envs;
            begin(b, e);
            continue;
        }
        for (int i = 0; i < N; i++) live[i] = s.live[i] != 0;
        observe(s, &b.obs[size_t(e) * N * OBS]);
    }
    return true;
}

int main(int argc, char** argv) {
    const int envs = argc > 1 ? std::atoi(argv[1]) : 1024;
    const bool checks = argc > 2 && !std::strcmp(argv[2], "check");
    const double part_s = argc > 2 && !checks ? std::atof(argv[2]) : 1.0;
    Batch b{envs, 0, 0, {}, {}, {}, {}, {}, {}, {}, {}, {}, {}, {}};
    b.pool = argc > 4 ? std::strtoull(argv[3], nullptr, 10) : 1;  // of the run's EpisodeSeeds
    b.constant = argc > 4 ? std::strtoull(argv[4], nullptr, 10) : 1;
    b.copies.resize(envs);
    b.obs.resize(size_t(envs) * N * OBS), b.last_obs.resize(b.obs.size());
    b.rewards.resize(envs * N), b.terms.resize(envs * N * 2);
    for (auto* flags : {&b.terminated, &b.truncated, &b.live, &b.last}) flags->resize(envs * N);
    b.over.resize(envs), b.ended.resize(envs);
    for (int e = 0; e < envs; e++) b.copies[e].number = e, begin(b, e);
    constexpr int DRAWN = 64;
    std::vector<int64_t> actions(size_t(DRAWN) * envs * N);
    uint64_t state = 12345;
    for (auto& action : actions) state = state * 6364136223846793005u + 1442695040888963407u, action = (state >> 33) % 5;
    auto row = [&](int64_t number) { return &actions[size_t(number % DRAWN) * envs * N]; };
    if (checks) {
        double shown = 0.0, paid = 0.0;
        for (int number = 0; number < 1000; number++) {
            step(b, row(number));
            for (float value : b.obs) shown += value;
            for (double value : b.rewards) paid += value;
        }
        std::printf("{\"task\": \"spread\", \"shown\": %.17g, \"paid\": %.17g}\n", shown, paid);
        return 0;
    }
    using clock = std::chrono::steady_clock;
    auto since = [](clock::time_point t) { return std::chrono::duration<double>(clock::now() - t).count(); };
    double best = 0.0;
    int64_t number = 0;
    for (int part = 0; part < 5; part++) {
        const auto start = clock::now();
        int64_t steps = 0;
        do {
            for (int k = 0; k < 16; k++, steps++) step(b, row(number++));
        } while (since(start) < part_s);
        best = std::max(best, double(steps) * envs * N / since(start));
    }
    std::printf("{\"task\": \"spread\", \"subject\": \"c++\", \"envs\": %d, \"agent_steps_per_s\": %.0f}\n", envs, best);
}
