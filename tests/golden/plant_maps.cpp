// Derivatives of the discrete map of the hydraulic system, for `plant_maps.json` of this folder.
//
//     g++ -O2 -std=c++17 plant_maps.cpp -o plant_maps && ./plant_maps > plant_maps.json
//
// Written from the paper (numbers in brackets are its equations) and the model page; shares no line with the Rust code
// and with drhas.py. Numbers have 64 bits of mantissa. One period is four steps of the classical Runge-Kutta method with
// the current held, as in the scenario; each derivative is the central difference of order 8, whose truncation and
// rounding are both near 1e-15 at a relative step of 4e-3.

#include <array>
#include <cmath>
#include <cstdio>
#include <functional>
#include <vector>

using Real = long double;
using State = std::array<Real, 10>;  // angle, rate, then position, velocity, pressures of each actuator

struct Point {
    const char *name;
    State x;
    std::array<Real, 2> u;        // currents
    std::array<Real, 2> leakage;  // C_t of the fault, m3/s/sqrt(Pa)
};

// Table 1.
constexpr Real K_I = 3.04e-3L, K_Q = 7.5e-5L, P_S = 28e6L, P_R = 0.0L, M_H = 55.0L, B_H = 1e4L, A = 1.47e-3L;
constexpr Real BETA = 800e6L, V_0 = 0.735e-4L, C_I = 1e-12L, K_H = 1e8L;
constexpr Real R_D = 0.15L, J_D = 13.5L, B_D = 51.75L, K_D = 9.14e5L;
constexpr std::array<Real, 2> DISTURBANCE = {100.0L, 400.0L};  // (74) before 2 s

Real root(Real drop) { return drop > 0 ? std::sqrt(drop) : 0; }

State rates(const Point &point, const State &x) {
    State dx{};
    Real torque = 0;
    for (int i = 0; i < 2; ++i) {
        const Real *q = &x[2 + 4 * i];
        const Real position = q[0], velocity = q[1], p_1 = q[2], p_2 = q[3];
        const Real spool = K_I * point.u[i];                                     // (1)
        const bool extends = spool >= 0;                                         // (9)
        const Real q_1 = K_Q * spool * root(extends ? P_S - p_1 : p_1 - P_R);    // (7), (10)
        const Real q_2 = K_Q * spool * root(extends ? p_2 - P_R : P_S - p_2);    // (8), (11)
        const Real drop = p_1 - p_2;
        const Real sign = drop < 0 ? -1 : 1;
        const Real leak = C_I * drop + point.leakage[i] * sign * std::sqrt(std::fabs(drop));  // (5)
        const Real force = K_H * (position - R_D * x[0]);                        // (14) to (16)
        Real *d = &dx[2 + 4 * i];
        d[0] = velocity;
        d[1] = (A * p_1 - A * p_2 - B_H * velocity - force - DISTURBANCE[i]) / M_H;  // (2)
        d[2] = BETA / (V_0 + A * position) * (q_1 - leak - A * velocity);        // (3)
        d[3] = BETA / (V_0 - A * position) * (A * velocity + leak - q_2);        // (4)
        torque += R_D * force;
    }
    dx[0] = x[1];
    dx[1] = (torque - B_D * x[1] - K_D * R_D * R_D * x[0]) / J_D;  // (17)
    return dx;
}

State moved(const State &x, Real h, const State &k) {
    State y;
    for (int i = 0; i < 10; ++i) y[i] = x[i] + h * k[i];
    return y;
}

State period(const Point &point) {
    State x = point.x;
    const Real h = 1e-4L / 4;
    for (int step = 0; step < 4; ++step) {
        const State k_1 = rates(point, x), k_2 = rates(point, moved(x, h / 2, k_1));
        const State k_3 = rates(point, moved(x, h / 2, k_2)), k_4 = rates(point, moved(x, h, k_3));
        for (int i = 0; i < 10; ++i) x[i] += h / 6 * (k_1[i] + 2 * k_2[i] + 2 * k_3[i] + k_4[i]);
    }
    return x;
}

// Central difference of order 8 by one number of a point.
State difference(Point point, const std::function<Real &(Point &)> &number) {
    const Real weights[] = {4.0L / 5, -1.0L / 5, 4.0L / 105, -1.0L / 280};
    const Real here = number(point), h = 4e-3L * std::fabs(here);
    State sum{};
    for (int j = 1; j <= 4; ++j)
        for (int side : {1, -1}) {
            number(point) = here + side * j * h;
            sum = moved(sum, side * weights[j - 1] / h, period(point));
        }
    return sum;
}

void print(const char *key, const std::vector<Real> &row, const char *end) {
    std::printf("   \"%s\": [", key);
    for (size_t i = 0; i < row.size(); ++i) std::printf("%s%.17Lg", i ? ", " : "", row[i]);
    std::printf("]%s\n", end);
}

int main() {
    // Away from equal pressures, from a current of 0 and from the stops; the third leaks.
    const Point points[] = {
        {"both extend",
         {0.05L, 0.4L, 0.008L, 0.06L, 15e6L, 13.5e6L, 0.0075L, 0.055L, 14.5e6L, 13e6L}, {0.02L, 0.02L}, {0, 0}},
        {"both retract",
         {-0.08L, -0.7L, -0.0119L, -0.1L, 12e6L, 16e6L, -0.0121L, -0.11L, 11e6L, 15e6L}, {-0.15L, -0.15L}, {0, 0}},
        {"both leak",
         {0.12L, -0.3L, 0.0181L, -0.04L, 18e6L, 9e6L, 0.0179L, -0.05L, 17e6L, 10e6L}, {0.3L, 0.3L}, {5e-7L, 1e-7L}},
    };
    std::printf("{\"points\": [\n");
    for (const Point &point : points) {
        std::printf("  {\"name\": \"%s\",\n", point.name);
        print("state", {point.x.begin(), point.x.end()}, ",");
        print("command_a", {point.u[0], point.u[1]}, ",");
        print("leakage_coefficient_m3ps_per_sqrt_pa", {point.leakage[0], point.leakage[1]}, ",");
        const State next = period(point);
        print("next", {next.begin(), next.end()}, ",");
        std::printf("   \"columns\": [\n");
        for (int j = 0; j < 12; ++j) {
            const State column = difference(point, [j](Point &p) -> Real & { return j < 10 ? p.x[j] : p.u[j - 10]; });
            std::printf("    [");
            for (int i = 0; i < 10; ++i) std::printf("%s%.17Lg", i ? ", " : "", column[i]);
            std::printf("]%s\n", j < 11 ? "," : "");
        }
        std::printf("   ]}%s\n", &point == &points[2] ? "" : ",");
    }
    std::printf("]}\n");
}
