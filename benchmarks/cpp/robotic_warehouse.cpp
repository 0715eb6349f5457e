// The task `robotic_warehouse` (src/gamekeeper/envs/robotic_warehouse.py), layout tiny, four robots, in C++: the same
// arrays written by a step of a batch, the same checks of actions, the same seeds and new episodes (same_step), the
// same bits.
//
//   g++ -O3 -march=native -ffp-contract=off robotic_warehouse.cpp -o robotic_warehouse
//   ./robotic_warehouse 1024 2.0    agent-steps a second of 1,024 copies, best of 5 parts of 2 seconds, as a JSON line
//   ./robotic_warehouse 64 check POOL CONSTANT    sums of what 64 copies show and pay in 1,000 steps, to compare

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>

constexpr int N = 4, REQUESTS = 4, ROWS = 11, COLUMNS = 10, HEIGHT = 8, MARGIN = 1;
constexpr int WIDTH = COLUMNS + 2 * MARGIN, CELLS = WIDTH * (ROWS + 2 * MARGIN), SENSED = 7, OWN = 8, LOOKS = 15;
constexpr int SIDE = 2 * MARGIN + 1, OBS = OWN + SENSED * SIDE * SIDE;
constexpr int64_t HORIZON = 500;
constexpr uint64_t WORD = 0xffffffffu;
enum Action { NOOP, FORWARD, LEFT, RIGHT, TOGGLE };
enum Kind { BEYOND, HIGHWAY, PLACE };

struct Tables {  // where everything is, and what a cell looks like
    int8_t floor[CELLS];
    int cells[ROWS * COLUMNS], homes[ROWS * COLUMNS], goals[2], shelves = 0, around[SIDE * SIDE];
    float own[CELLS][3], look[LOOKS][SENSED];
};
constexpr int AHEAD[4] = {-WIDTH, WIDTH, -1, 1}, TURNED[2][4] = {{2, 3, 1, 0}, {3, 2, 0, 1}};

struct Copy {
    int64_t seed, draws, block, number, time;
    uint32_t words[4];
    int idle, delivered;
    int16_t cell[N], to[N], behind[N];
    int8_t live[N], ending[N], facing[N], load[N];
    int8_t sight[CELLS], robots[CELLS], claims[CELLS];
};

struct Batch {
    int envs;
    uint64_t pool, constant;
    Tables tables;
    std::vector<Copy> copies;
    std::vector<float> obs, last_obs;
    std::vector<double> rewards;
    std::vector<uint8_t> terminated, truncated, live, last, over, ended;
};

static Tables tables_of_tiny() {
    Tables t{};
    for (int y = 0; y < ROWS; y++)
        for (int x = 0; x < COLUMNS; x++) {
            const int cell = (y + MARGIN) * WIDTH + x + MARGIN;
            const bool queue = y > ROWS - (HEIGHT + 3) && (x == COLUMNS / 2 - 1 || x == COLUMNS / 2);
            const bool highway = x % 3 == 0 || y % (HEIGHT + 1) == 0 || y == ROWS - 1 || queue;
            t.floor[cell] = highway ? HIGHWAY : PLACE;
            t.cells[y * COLUMNS + x] = cell;
            if (!highway) t.homes[t.shelves++] = cell;
        }
    for (int g = 0; g < 2; g++) t.goals[g] = (ROWS - 1 + MARGIN) * WIDTH + COLUMNS / 2 - 1 + g + MARGIN;
    for (int k = 0; k < SIDE * SIDE; k++) t.around[k] = (k / SIDE - MARGIN) * WIDTH + k % SIDE - MARGIN;
    for (int c = 0; c < CELLS; c++) {
        t.own[c][0] = float(c % WIDTH - MARGIN), t.own[c][1] = float(c / WIDTH - MARGIN);
        t.own[c][2] = t.floor[c] == PLACE ? 0.0f : 1.0f;
    }
    for (int code = 0; code < LOOKS; code++) {
        const int shelf = code / 5, robot = code % 5;
        t.look[code][0] = robot > 0, t.look[code][1 + std::max(robot - 1, 0)] = 1.0f;
        t.look[code][5] = shelf > 0, t.look[code][6] = shelf == 2;
    }
    return t;
}

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
            const uint32_t n0 = uint32_t(p1 >> 32) ^ c1 ^ k0, n2 = uint32_t(p0 >> 32) ^ c3 ^ k1;
            c0 = n0, c1 = uint32_t(p1), c2 = n2, c3 = uint32_t(p0);
            k0 += 0x9E3779B9u, k1 += 0xBB67AE85u;
        }
        s.words[0] = c0, s.words[1] = c1, s.words[2] = c2, s.words[3] = c3, s.block = block;
    }
    return s.words[drawn & 3];
}

static int integers(Copy& s, uint32_t bound) {
    uint64_t product = uint64_t(word(s)) * bound;
    if ((product & WORD) < bound) {
        const uint64_t refused = (WORD + 1) % bound;
        while ((product & WORD) < refused) product = uint64_t(word(s)) * bound;
    }
    return int(product >> 32);
}

static void begin(Batch& b, Copy& s) {
    const Tables& t = b.tables;
    const int64_t number = s.number;
    std::memset(&s, 0, sizeof s);
    s.number = number, s.seed = episode_seed(b.pool, b.constant, uint64_t(number)), s.block = -1;
    for (int k = 0; k < t.shelves; k++) s.sight[t.homes[k]] = 5;
    for (int i = 0; i < N; i++) {
        int cell;
        do cell = t.cells[integers(s, ROWS * COLUMNS)];
        while (s.robots[cell]);
        s.live[i] = 1, s.robots[cell] = int8_t(i + 1), s.cell[i] = s.to[i] = int16_t(cell);
    }
    for (int i = 0; i < N; i++) s.facing[i] = int8_t(integers(s, 4)), s.sight[s.cell[i]] += int8_t(1 + s.facing[i]);
    for (int k = 0; k < REQUESTS; k++) {
        int cell;
        do cell = t.homes[integers(s, uint32_t(t.shelves))];
        while (s.sight[cell] >= 10);
        s.sight[cell] += 5;
    }
}

static bool goes(const Copy& s, int i) {
    int k = i;
    for (int length = 1; length <= N; length++) {
        if (s.to[k] == s.cell[k] || s.claims[s.to[k]] != k + 1) return false;
        k = s.robots[s.to[k]] - 1;
        if (k < 0) return true;
        if (k == i) return length != 2;
    }
    return false;
}

static void move(Copy& s) {
    for (int i = 0; i < N; i++)
        if (s.to[i] != s.cell[i]) {
            int length = 1, k = s.robots[s.to[i]] - 1;
            while (k >= 0 && s.to[k] != s.cell[k] && s.behind[k] < length && length < N)
                s.behind[k] = int16_t(length++), k = s.robots[s.to[k]] - 1;
        }
    for (int i = 0; i < N; i++)
        if (s.to[i] != s.cell[i]) {
            const int best = s.claims[s.to[i]] - 1;
            if (best < 0 || s.behind[best] < s.behind[i]) s.claims[s.to[i]] = int8_t(i + 1);
        }
    for (int i = 0; i < N; i++) s.behind[i] = goes(s, i);
    for (int i = 0; i < N; i++) {
        s.claims[s.to[i]] = 0;
        if (!s.behind[i]) {
            s.to[i] = s.cell[i];
        } else {
            s.behind[i] = s.load[i] ? s.sight[s.cell[i]] : int16_t(1 + s.facing[i]);
            s.sight[s.cell[i]] -= int8_t(s.behind[i]), s.robots[s.cell[i]] = 0;
        }
    }
    for (int i = 0; i < N; i++)
        if (s.behind[i]) {
            s.cell[i] = s.to[i];
            s.sight[s.cell[i]] += int8_t(s.behind[i]), s.robots[s.cell[i]] = int8_t(i + 1), s.behind[i] = 0;
        }
}

static void play(Copy& s, const Tables& t, const int64_t* actions, double* rewards) {
    int going = 0;
    for (int i = 0; i < N; i++)
        if (actions[i] == FORWARD) {
            const int cell = s.cell[i] + AHEAD[s.facing[i]];
            if (t.floor[cell] == BEYOND) continue;
            const int other = s.robots[cell] - 1;
            const bool stands = s.sight[cell] >= 5 && !(other >= 0 && s.load[other]);
            if (!s.load[i] || !stands) s.to[i] = int16_t(cell), going++;
        }
    if (going) move(s);
    for (int i = 0; i < N; i++) {
        if (actions[i] == TOGGLE) {
            if (!s.load[i])
                s.load[i] = s.sight[s.cell[i]] >= 5;
            else if (t.floor[s.cell[i]] == PLACE)
                s.load[i] = 0;
        } else if (actions[i] == LEFT || actions[i] == RIGHT) {
            const int facing = TURNED[actions[i] - LEFT][s.facing[i]];
            s.sight[s.cell[i]] += int8_t(facing - s.facing[i]), s.facing[i] = int8_t(facing);
        }
    }
    s.idle++;
    for (int goal : t.goals)
        if (s.sight[goal] >= 10) {
            s.idle = 0, s.delivered++;
            int left = integers(s, uint32_t(t.shelves - REQUESTS));
            for (auto& cell : s.sight)
                if (cell >= 5 && cell < 10 && left-- == 0) {
                    cell += 5;
                    break;
                }
            s.sight[goal] -= 5;
            rewards[s.robots[goal] - 1] += 1.0;
        }
}

static void observe(const Copy& s, const Tables& t, float* obs) {
    for (int i = 0; i < N; i++, obs += OBS) {
        const int cell = s.cell[i];
        obs[0] = t.own[cell][0], obs[1] = t.own[cell][1], obs[2] = s.load[i], obs[7] = t.own[cell][2];
        for (int d = 0; d < 4; d++) obs[3 + d] = s.facing[i] == d;
        for (int k = 0; k < SIDE * SIDE; k++)
            std::memcpy(obs + OWN + SENSED * k, t.look[s.sight[cell + t.around[k]]], sizeof t.look[0]);
    }
}

static void show(const Copy& s, const Tables& t, bool is_after, const uint8_t* terminated, const uint8_t* truncated, float* obs) {
    observe(s, t, obs);
    for (int i = 0; i < N; i++)
        if (!s.live[i] && !(is_after && (terminated[i] || truncated[i]))) std::fill_n(obs + OBS * i, OBS, 0.0f);
}

static bool step(Batch& b, const int64_t* actions) {
    bool is_fine = true;
    for (int k = 0; k < b.envs * N; k++) is_fine &= (!b.live[k]) | ((actions[k] >= 0) & (actions[k] < 5));
    if (!is_fine) return false;
    for (int e = 0; e < b.envs; e++) {
        Copy& s = b.copies[e];
        double* rewards = &b.rewards[e * N];
        uint8_t *terminated = &b.terminated[e * N], *truncated = &b.truncated[e * N], *live = &b.live[e * N];
        for (int i = 0; i < N; i++) rewards[i] = 0.0, terminated[i] = truncated[i] = 0;
        s.time++;
        play(s, b.tables, actions + e * N, rewards);
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
            for (int i = 0; i < N; i++) b.last[e * N + i] = live[i] || terminated[i] || truncated[i];
            observe(s, b.tables, &b.last_obs[e * N * OBS]);
            for (int i = 0; i < N; i++)
                if (!b.last[e * N + i]) std::fill_n(&b.last_obs[(e * N + i) * OBS], OBS, 0.0f);
            s.number += b.envs;
            begin(b, s);
        }
        for (int i = 0; i < N; i++) live[i] = s.live[i] != 0;
        show(s, b.tables, left > 0, terminated, truncated, &b.obs[e * N * OBS]);
        b.ended[e] = left == 0, b.over[e] = 0;
    }
    return true;
}

int main(int argc, char** argv) {
    const int envs = argc > 1 ? std::atoi(argv[1]) : 1024;
    const bool checks = argc > 2 && !std::strcmp(argv[2], "check");
    const double part_s = argc > 2 && !checks ? std::atof(argv[2]) : 1.0;
    Batch b{envs, 1, 1, tables_of_tiny(), {}, {}, {}, {}, {}, {}, {}, {}, {}, {}};
    if (argc > 4) b.pool = std::strtoull(argv[3], nullptr, 10), b.constant = std::strtoull(argv[4], nullptr, 10);
    b.copies.resize(envs);
    b.obs.resize(envs * N * OBS), b.last_obs.resize(envs * N * OBS), b.rewards.resize(envs * N);
    for (auto* flags : {&b.terminated, &b.truncated, &b.live, &b.last}) flags->resize(envs * N);
    b.over.resize(envs), b.ended.resize(envs);
    for (int e = 0; e < envs; e++) {
        b.copies[e].number = e;
        begin(b, b.copies[e]);
        for (int i = 0; i < N; i++) b.live[e * N + i] = 1;
        show(b.copies[e], b.tables, false, &b.terminated[e * N], &b.truncated[e * N], &b.obs[e * N * OBS]);
    }
    constexpr int DRAWN = 64;
    std::vector<int64_t> actions(size_t(DRAWN) * envs * N);
    uint64_t state = 12345;
    for (auto& action : actions) state = state * 6364136223846793005u + 1442695040888963407u, action = (state >> 33) % 5;
    auto row = [&](int64_t number) { return &actions[size_t(number % DRAWN) * envs * N]; };
    if (checks) {
        double shown = 0.0, paid = 0.0;
        for (int number = 0; number < 1000; number++) {
            step(b, row(number));
            for (auto value : b.obs) shown += double(value);
            for (auto value : b.rewards) paid += value;
        }
        std::printf("{\"task\": \"robotic_warehouse\", \"shown\": %.17g, \"paid\": %.17g}\n", shown, paid);
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
        "{\"task\": \"robotic_warehouse\", \"subject\": \"c++\", \"envs\": %d, \"agent_steps_per_s\": %.0f}\n", envs, best);
}
