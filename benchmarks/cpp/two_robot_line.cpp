// The task `two_robot_line` (src/gamekeeper/envs/two_robot_line.py) in C++: the same arrays written by a step of a
// batch, the same checks of actions, the same seeds and new episodes (same_step), the same bits.
//
//   g++ -O3 -march=native -ffp-contract=off two_robot_line.cpp -o two_robot_line
//   ./two_robot_line 1024 2.0    agent-steps a second of 1,024 copies, best of 5 parts of 2 seconds, as a JSON line
//   ./two_robot_line 64 check POOL CONSTANT    sums of what 64 copies show and pay in 1,000 steps, to compare with ours

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>

constexpr int N = 2;
constexpr int64_t HORIZON = 200;
constexpr uint64_t WORD = 0xffffffffu;

struct Tables {
    int64_t last, picker, carrier;
};

struct Copy {  // as a kernel's record: the stream's fields first
    int64_t seed, episode, lane, draws, block, words[4], number, time;
    int8_t live[N], ending[N];
    int64_t cells[N];
};

struct Batch {
    int envs;
    uint64_t pool, constant;
    Tables tables;
    std::vector<Copy> copies;
    std::vector<int64_t> obs, last_obs, last_infos;
    std::vector<double> rewards;
    std::vector<uint8_t> terminated, truncated, live, last, over, ended;
};

static int64_t episode_seed(uint64_t pool, uint64_t constant, uint64_t episode) {
    constexpr uint64_t INIT_B = 0x8b51f9dd, MULT_A = 0x931e8875, MULT_B = 0x58f38ded, MIX_R = 0x4973f715;
    uint64_t value = ((episode ^ constant) * (constant * MULT_A & WORD)) & WORD;
    value = (pool - (MIX_R * (value ^ (value >> 16)) & WORD)) & WORD;
    value = (((value ^ (value >> 16)) ^ INIT_B) * (INIT_B * MULT_B & WORD)) & WORD;
    return int64_t((value ^ (value >> 16)) >> 1);
}

static void begin(Batch& b, Copy& s) {
    const int64_t number = s.number;
    std::memset(&s, 0, sizeof s);
    s.number = number, s.seed = episode_seed(b.pool, b.constant, uint64_t(number)), s.block = -1;
    for (int i = 0; i < N; i++) s.live[i] = 1;
    s.cells[0] = b.tables.picker, s.cells[1] = b.tables.carrier;
}

static void play(Copy& s, const Tables& t, const int64_t* actions, double* rewards, uint8_t* terminated) {
    for (int i = 0; i < N; i++) s.cells[i] = std::min(std::max(s.cells[i] + actions[i] - 1, int64_t(0)), t.last);
    if (s.cells[0] == s.cells[1])
        for (int i = 0; i < N; i++) rewards[i] = 1.0, terminated[i] = 1, s.ending[i] = 1;
}

static void show(const Copy& s, bool is_after, const uint8_t* terminated, const uint8_t* truncated, int64_t* obs) {
    for (int i = 0; i < N; i++) obs[i] = s.cells[i];
    for (int i = 0; i < N; i++)
        if (!s.live[i] && !(is_after && (terminated[i] || truncated[i]))) obs[i] = 0;
}

static bool step(Batch& b, const int64_t* actions) {
    bool is_fine = true;
    for (int k = 0; k < b.envs * N; k++) is_fine &= !b.live[k] | ((actions[k] >= 0) & (actions[k] < 3));
    if (!is_fine) return false;
    for (int e = 0; e < b.envs; e++) {
        Copy& s = b.copies[e];
        double* rewards = &b.rewards[e * N];
        uint8_t *terminated = &b.terminated[e * N], *truncated = &b.truncated[e * N], *live = &b.live[e * N];
        for (int i = 0; i < N; i++) rewards[i] = 0.0, terminated[i] = truncated[i] = 0;
        s.time++;
        play(s, b.tables, actions + e * N, rewards, terminated);
        int left = 0;
        for (int i = 0; i < N; i++)
            if (s.live[i]) {
                if (terminated[i] || truncated[i]) {
                    if (!s.ending[i]) s.ending[i] = 127;
                } else if (s.time >= HORIZON) {
                    truncated[i] = 1, s.ending[i] = -1;
                } else {
                    left++;
                }
            }
        for (int i = 0; i < N; i++)
            if (terminated[i] || truncated[i]) s.live[i] = 0;
        if (left == 0) {
            uint8_t* last = &b.last[e * N];
            for (int i = 0; i < N; i++) {
                last[i] = live[i] || terminated[i] || truncated[i];
                b.last_obs[e * N + i] = b.last_infos[e * N + i] = s.cells[i];
                if (!last[i]) b.last_obs[e * N + i] = 0;
            }
            s.number += b.envs;
            begin(b, s);
        }
        for (int i = 0; i < N; i++) live[i] = s.live[i] != 0;
        show(s, left > 0, terminated, truncated, &b.obs[e * N]);
        b.ended[e] = left == 0, b.over[e] = 0;
    }
    return true;
}

int main(int argc, char** argv) {
    const int envs = argc > 1 ? std::atoi(argv[1]) : 1024;
    const bool checks = argc > 2 && !std::strcmp(argv[2], "check");
    const double part_s = argc > 2 && !checks ? std::atof(argv[2]) : 1.0;
    Batch b{envs, 1, 1, {4, 0, 4}, {}, {}, {}, {}, {}, {}, {}, {}, {}, {}, {}};
    if (argc > 4) b.pool = std::strtoull(argv[3], nullptr, 10), b.constant = std::strtoull(argv[4], nullptr, 10);
    b.copies.resize(envs);
    for (auto* numbers : {&b.obs, &b.last_obs, &b.last_infos}) numbers->resize(envs * N);
    b.rewards.resize(envs * N);
    for (auto* flags : {&b.terminated, &b.truncated, &b.live, &b.last}) flags->resize(envs * N);
    b.over.resize(envs), b.ended.resize(envs);
    for (int e = 0; e < envs; e++) {
        b.copies[e].number = e;
        begin(b, b.copies[e]);
        for (int i = 0; i < N; i++) b.live[e * N + i] = 1;
        show(b.copies[e], false, &b.terminated[e * N], &b.truncated[e * N], &b.obs[e * N]);
    }
    constexpr int DRAWN = 64;
    std::vector<int64_t> actions(size_t(DRAWN) * envs * N);
    uint64_t state = 12345;
    for (auto& action : actions) state = state * 6364136223846793005u + 1442695040888963407u, action = (state >> 33) % 3;
    auto row = [&](int64_t number) { return &actions[size_t(number % DRAWN) * envs * N]; };
    if (checks) {
        double shown = 0.0, paid = 0.0;
        for (int number = 0; number < 1000; number++) {
            step(b, row(number));
            for (auto value : b.obs) shown += double(value);
            for (auto value : b.rewards) paid += value;
        }
        std::printf("{\"task\": \"two_robot_line\", \"shown\": %.17g, \"paid\": %.17g}\n", shown, paid);
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
            for (int k = 0; k < 16; k++, steps++)
                if (!step(b, row(number++))) return 1;
        } while (since(start) < part_s);
        best = std::max(best, double(steps) * envs * N / since(start));
    }
    std::printf(
        "{\"task\": \"two_robot_line\", \"subject\": \"c++\", \"envs\": %d, \"agent_steps_per_s\": %.0f}\n", envs, best);
}
