/*
 * scenarios/severe-leakage.toml in plain C: the same plant, integrator, stimulus, fault and FTSC law,
 * in one thread, without frames, records or faults of any other kind. What `hil run` is measured
 * against by the bench `c_twin`, which compiles this file with `cc -O3 -std=c11`.
 *
 * Equation numbers are those of Mathematical Problems in Engineering, 2018, article 6570104. The
 * numbers are what `hil config show scenarios/severe-leakage.toml` prints; SI units throughout.
 * Prints one line of JSON: wall time of the loop, final state, and the metrics of the scenario.
 */
#define _POSIX_C_SOURCE 200809L
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#define TAU 6.283185307179586
#define RATE 10000.0
#define STEPS 200000
#define SUBSTEPS 4
#define PARTS_OF_EMPTYING_SUBSTEP 4

/* Plant */

typedef struct {
    double valve_gain, valve_travel, flow_gain;
    double supply_pressure, return_pressure, vapour_pressure;
    double mass, damping, area1, area2;
    double bulk_modulus, volume1, volume2;
    double internal_leakage, fault_leakage;
    double connection_stiffness;
    double disturbance_constant, disturbance_amplitude, disturbance_frequency, disturbance_start;
} Actuator;

typedef struct {
    double radius, inertia, damping, load_stiffness;
} Surface;

typedef struct {
    Actuator actuator[2];
    Surface surface;
} Plant;

typedef struct {
    double position, velocity, pressure1, pressure2;
} ActuatorState;

typedef struct {
    double angle, rate;
    ActuatorState actuator[2];
} State;

enum { STATES = sizeof(State) / sizeof(double) };

/* A state as the vector that Runge-Kutta adds up. */
typedef union {
    State s;
    double x[STATES];
} Vector;

/* What acts whatever the state: positions of the spools and disturbances. */
typedef struct {
    double spool[2], disturbance[2];
} Inputs;

/* Table 1 and eq. 74. */
static Plant table_1(void)
{
    const Actuator one = {
        .valve_gain = 3.04e-3, .valve_travel = 0.02, .flow_gain = 7.5e-5,
        .supply_pressure = 28e6, .return_pressure = 0.0, .vapour_pressure = -1e5,
        .mass = 55.0, .damping = 1e4, .area1 = 1.47e-3, .area2 = 1.47e-3,
        .bulk_modulus = 800e6, .volume1 = 0.735e-4, .volume2 = 0.735e-4,
        .internal_leakage = 1e-12, .fault_leakage = 0.0,
        .connection_stiffness = 1e8,
        .disturbance_constant = 100.0, .disturbance_amplitude = 400.0,
        .disturbance_frequency = 1.0, .disturbance_start = 2.0,
    };
    Plant plant = {
        .actuator = {one, one},
        .surface = {.radius = 0.15, .inertia = 13.5, .damping = 51.75, .load_stiffness = 9.14e5},
    };
    plant.actuator[1].disturbance_constant = 400.0;
    plant.actuator[1].disturbance_amplitude = 0.0;
    return plant;
}

/* Eq. 1 with stops. */
static double spool_position(const Actuator *a, double current)
{
    double x_v = a->valve_gain * current;
    if (x_v > a->valve_travel)
        return a->valve_travel;
    if (x_v < -a->valve_travel)
        return -a->valve_travel;
    return x_v;
}

/* Eq. 74. */
static double disturbance(const Actuator *a, double t)
{
    if (a->disturbance_amplitude == 0.0 || t < a->disturbance_start)
        return a->disturbance_constant;
    double turns = a->disturbance_frequency * t;
    return a->disturbance_constant + a->disturbance_amplitude * sin(TAU * (turns - floor(turns)));
}

static double root(double drop)
{
    return drop > 0.0 ? sqrt(drop) : 0.0;
}

/* Factors of eqs. 3 and 4. */
static double stiffness1(const Actuator *a, double position)
{
    return a->bulk_modulus / (a->volume1 + a->area1 * position);
}

static double stiffness2(const Actuator *a, double position)
{
    return a->bulk_modulus / (a->volume2 - a->area2 * position);
}

/* Eqs. 2 to 13 of one actuator. */
static ActuatorState actuator_rates(const Actuator *a, double fault_leakage, const ActuatorState *s,
                                    double rod_force, double x_v, double d)
{
    double y = s->pressure1 - s->pressure2;
    double root_y = sqrt(fabs(y));
    double q_h = a->internal_leakage * y + fault_leakage * (y < 0.0 ? -root_y : root_y);
    double r_1, r_2;
    if (x_v > 0.0) {
        r_1 = root(a->supply_pressure - s->pressure1);
        r_2 = root(s->pressure2 - a->return_pressure);
    } else {
        r_1 = root(s->pressure1 - a->return_pressure);
        r_2 = root(a->supply_pressure - s->pressure2);
    }
    double q_h1 = a->flow_gain * x_v * r_1;
    double q_h2 = a->flow_gain * x_v * r_2;
    double v = s->velocity;
    return (ActuatorState){
        .position = v,
        .velocity = (a->area1 * s->pressure1 - a->area2 * s->pressure2 - a->damping * v - rod_force - d)
                    / a->mass,
        .pressure1 = stiffness1(a, s->position) * (-a->area1 * v - q_h + q_h1),
        .pressure2 = stiffness2(a, s->position) * (a->area2 * v + q_h - q_h2),
    };
}

/* Eqs. 2 to 17 and 24. */
static State rates(const Plant *p, const double fault_leakage[2], const Inputs *in, const State *s)
{
    const Surface *surface = &p->surface;
    double x_d = surface->radius * s->angle;
    double force[2];
    State rate;
    for (int i = 0; i < 2; i++) {
        const Actuator *a = &p->actuator[i];
        force[i] = a->connection_stiffness * (s->actuator[i].position - x_d);
        rate.actuator[i] = actuator_rates(a, fault_leakage[i], &s->actuator[i], force[i],
                                          in->spool[i], in->disturbance[i]);
    }
    double load = surface->radius * (surface->load_stiffness * x_d);
    rate.angle = s->rate;
    rate.rate = ((force[0] + force[1]) * surface->radius - surface->damping * s->rate - load)
                / surface->inertia;
    return rate;
}

static Vector along(const Vector *x, double h, const Vector *k)
{
    Vector y;
    for (int i = 0; i < STATES; i++)
        y.x[i] = x->x[i] + h * k->x[i];
    return y;
}

/* The classical Runge-Kutta step; inputs at its begin, middle and end. */
static void runge_kutta(const Plant *p, const double fault_leakage[2], const Inputs in[3], double h,
                        State *state)
{
    Vector x = {.s = *state}, y, k1, k2, k3, k4;
    k1.s = rates(p, fault_leakage, &in[0], &x.s);
    y = along(&x, 0.5 * h, &k1);
    k2.s = rates(p, fault_leakage, &in[1], &y.s);
    y = along(&x, 0.5 * h, &k2);
    k3.s = rates(p, fault_leakage, &in[1], &y.s);
    y = along(&x, h, &k3);
    k4.s = rates(p, fault_leakage, &in[2], &y.s);
    for (int i = 0; i < STATES; i++)
        x.x[i] += h / 6.0 * (k1.x[i] + 2.0 * (k2.x[i] + k3.x[i]) + k4.x[i]);
    *state = x.s;
}

/* Whether the fault's leak alone would make the pressures equal within h. */
static bool empties(const Actuator *a, const ActuatorState *s, double h)
{
    if (a->fault_leakage == 0.0)
        return false;
    double speed = a->fault_leakage * (stiffness1(a, s->position) + stiffness2(a, s->position));
    return sqrt(fabs(s->pressure1 - s->pressure2)) < 0.5 * speed * h;
}

/* The exact flow of the fault's leak alone at fixed volumes. */
static void leak_alone(const Actuator *a, ActuatorState *s, double h)
{
    double active = stiffness1(a, s->position), passive = stiffness2(a, s->position);
    double y_0 = s->pressure1 - s->pressure2;
    double left = sqrt(fabs(y_0)) - 0.5 * a->fault_leakage * (active + passive) * h;
    if (left > 0.0) {
        double moved = (y_0 - (y_0 < 0.0 ? -left * left : left * left)) / (active + passive);
        s->pressure1 -= active * moved;
        s->pressure2 += passive * moved;
    } else {
        s->pressure1 -= active * (y_0 / (active + passive));
        s->pressure2 = s->pressure1;
    }
}

/* A substep or a part of one: the leak inside Runge-Kutta, or around it where it would empty. */
static void part_of_substep(const Plant *p, const Inputs in[3], double h, State *state)
{
    bool apart[2];
    double fault_leakage[2];
    for (int i = 0; i < 2; i++) {
        apart[i] = empties(&p->actuator[i], &state->actuator[i], h);
        fault_leakage[i] = apart[i] ? 0.0 : p->actuator[i].fault_leakage;
        if (apart[i])
            leak_alone(&p->actuator[i], &state->actuator[i], 0.5 * h);
    }
    runge_kutta(p, fault_leakage, in, h, state);
    for (int i = 0; i < 2; i++) {
        const Actuator *a = &p->actuator[i];
        ActuatorState *s = &state->actuator[i];
        if (apart[i])
            leak_alone(a, s, 0.5 * h);
        if (s->pressure1 < a->vapour_pressure)
            s->pressure1 = a->vapour_pressure;
        if (s->pressure2 < a->vapour_pressure)
            s->pressure2 = a->vapour_pressure;
    }
}

/* One control period under constant currents. */
static void advance(const Plant *p, double start, const double current[2], State *state)
{
    const double h = 1.0 / RATE / SUBSTEPS;
    Inputs in[3];
    for (int i = 0; i < 2; i++) {
        double x_v = spool_position(&p->actuator[i], current[i]);
        in[0].spool[i] = in[1].spool[i] = in[2].spool[i] = x_v;
        in[2].disturbance[i] = disturbance(&p->actuator[i], start);
    }
    for (int substep = 0; substep < SUBSTEPS; substep++) {
        bool cut = empties(&p->actuator[0], &state->actuator[0], h)
                   || empties(&p->actuator[1], &state->actuator[1], h);
        int parts = cut ? PARTS_OF_EMPTYING_SUBSTEP : 1;
        double part_h = h / parts;
        for (int part = 0; part < parts; part++) {
            double t = start + substep * h + part * part_h;
            for (int i = 0; i < 2; i++) {
                in[0].disturbance[i] = in[2].disturbance[i];
                in[1].disturbance[i] = disturbance(&p->actuator[i], t + 0.5 * part_h);
                in[2].disturbance[i] = disturbance(&p->actuator[i], t + part_h);
            }
            part_of_substep(p, in, part_h, state);
        }
    }
}

/* Eq. 6: severe leakage of both actuators from 7 s on. */
static void let_leak(Plant *p, double t)
{
    static const double coefficient[2] = {5e-7, 1e-7}, speed[2] = {10.0, 0.5};
    if (t < 7.0)
        return;
    for (int i = 0; i < 2; i++)
        p->actuator[i].fault_leakage = coefficient[i] * -expm1(-speed[i] * (t - 7.0));
}

/* Stimulus: theta_r = atan(0.2 sin 2 pi t) (1 - exp(-0.1 t^3)) with its derivatives, in truncated
 * Taylor arithmetic (Griewank and Walther, Evaluating Derivatives, section 13.2). */

enum { ORDER = 5, TERMS = ORDER + 1 };

static void product(const double a[TERMS], const double b[TERMS], double c[TERMS])
{
    for (int k = 0; k < TERMS; k++) {
        double sum = a[0] * b[k];
        for (int j = 1; j <= k; j++)
            sum += a[j] * b[k - j];
        c[k] = sum;
    }
}

static void sine(const double u[TERMS], double s[TERMS])
{
    double c[TERMS];
    s[0] = sin(u[0]);
    c[0] = cos(u[0]);
    for (int k = 1; k < TERMS; k++) {
        double s_k = 0.0, c_k = 0.0;
        for (int j = 1; j <= k; j++) {
            s_k += j * u[j] * c[k - j];
            c_k -= j * u[j] * s[k - j];
        }
        s[k] = s_k / k;
        c[k] = c_k / k;
    }
}

static void arc_tangent(const double u[TERMS], double y[TERMS])
{
    double g[TERMS];
    product(u, u, g);
    g[0] += 1.0;
    y[0] = atan(u[0]);
    for (int k = 1; k < TERMS; k++) {
        double y_k = k * u[k];
        for (int j = 1; j < k; j++)
            y_k -= j * y[j] * g[k - j];
        y[k] = y_k / (k * g[0]);
    }
}

static void exponential_less_1(const double u[TERMS], double e[TERMS])
{
    double less_1 = expm1(u[0]);
    e[0] = less_1 + 1.0;
    for (int k = 1; k < TERMS; k++) {
        double e_k = 0.0;
        for (int j = 1; j <= k; j++)
            e_k += j * u[j] * e[k - j];
        e[k] = e_k / k;
    }
    e[0] = less_1;
}

static void stimulus(double t, double derivative[TERMS])
{
    static const double factorial[TERMS] = {1.0, 1.0, 2.0, 6.0, 24.0, 120.0};
    const double angle[TERMS] = {TAU * (t - floor(t)), TAU};
    const double cube[TERMS] = {-0.1 * t * t * t, -0.1 * 3.0 * t * t, -0.1 * 3.0 * t, -0.1};
    double wave[TERMS], deflection[TERMS], onset[TERMS];
    sine(angle, wave);
    for (int k = 0; k < TERMS; k++)
        wave[k] *= 0.2;
    arc_tangent(wave, deflection);
    exponential_less_1(cube, onset);
    product(deflection, onset, derivative);
    for (int k = 0; k < TERMS; k++)
        derivative[k] *= -factorial[k];
}

/* FTSC, eqs. 24 to 73. Component 0 is the sum of both actuators, component 1 their difference. */

typedef struct {
    Plant model; /* Table 1; neither disturbances nor leakage */
    double m_1[2][2], m_2[2][2], m_3[2][2], m_3_inverse[2][2], m_4[2][2], t[2][2];
    double velocity_gain, force_gain;
    double lambda, mu;
    double last_velocity[2], initial_v3;
    long sample;
    double estimate[2];
} Law;

static const double K_ANGLE = 300.0, K_RATE = 300.0;
static const double K_1 = 1000.0, K_2S = 1000.0, K_3S = 1000.0;
static const double H_2 = 3.4e18, EPSILON = 1e14, H_3 = 2.5e23, XI = 1e21;
static const double LEARNING_RATE = 1e-37, ESTIMATE_MIN = 0.0, ESTIMATE_MAX = 5e-6;

static void multiply(double a[2][2], double b[2][2], double c[2][2])
{
    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 2; j++)
            c[i][j] = a[i][0] * b[0][j] + a[i][1] * b[1][j];
}

static void apply(const double m[2][2], const double v[2], double w[2])
{
    for (int i = 0; i < 2; i++)
        w[i] = m[i][0] * v[0] + m[i][1] * v[1];
}

/* Eqs. 34, 35, 45 to 61. */
static Law law_start(void)
{
    Law law = {.model = table_1()};
    const Actuator *a = law.model.actuator;
    double k[2], m[2], b[2], r_d = law.model.surface.radius;
    for (int i = 0; i < 2; i++) {
        k[i] = a[i].connection_stiffness;
        m[i] = a[i].mass;
        b[i] = a[i].damping;
    }
    double t[2][2] = {{k[0], k[1]}, {k[0], -k[1]}};
    double t_inverse[2][2] = {{0.5 / k[0], 0.5 / k[0]}, {0.5 / k[1], -0.5 / k[1]}};
    double h_1[2][2] = {{k[0] / m[0], 0.0}, {0.0, k[1] / m[1]}};
    double h_2[2][2] = {{b[0] / m[0], 0.0}, {0.0, b[1] / m[1]}};
    double h_3[2][2] = {{1.0 / m[0], 0.0}, {0.0, 1.0 / m[1]}};
    double h_4[2][2] = {{k[0] * r_d / m[0], 0.0}, {0.0, k[1] * r_d / m[1]}};
    double masses[2][2] = {{m[0], 0.0}, {0.0, m[1]}}, product_[2][2];
    memcpy(law.t, t, sizeof t);
    multiply(t, h_1, product_);
    multiply(product_, t_inverse, law.m_1);
    multiply(t, h_2, product_);
    multiply(product_, t_inverse, law.m_2);
    multiply(t, h_3, law.m_3);
    multiply(masses, t_inverse, law.m_3_inverse);
    multiply(t, h_4, law.m_4);
    law.velocity_gain = K_2S + H_2 / (4.0 * EPSILON);
    law.force_gain = K_3S + H_3 / (4.0 * XI);
    law.lambda = 2.0 * K_1;
    law.mu = 2.0 * (EPSILON + XI);
    return law;
}

/* Eqs. 24 to 33: x_r with three derivatives, from the surface's angle with four and theta_r. */
static void trajectory(const Law *law, const double y[5], const double theta_r[TERMS],
                       double x_r[4][2])
{
    const Surface *surface = &law->model.surface;
    double r_d = surface->radius, j_d = surface->inertia;
    double k_1 = law->model.actuator[0].connection_stiffness;
    double k_2 = law->model.actuator[1].connection_stiffness;
    double z_1[5], alpha[5];
    for (int j = 0; j < 5; j++) {
        z_1[j] = y[j] - theta_r[j];
        alpha[j] = -K_ANGLE * z_1[j] + theta_r[j + 1];
    }
    for (int j = 0; j < 4; j++) {
        double z_2 = y[j + 1] - alpha[j];
        double load = surface->load_stiffness * r_d * r_d * y[j];
        x_r[j][0] = (r_d * r_d * (k_1 + k_2) * y[j] + surface->damping * y[j + 1] + load) / r_d
                    + j_d / r_d * (alpha[j + 1] - K_RATE * z_2 - z_1[j]);
        x_r[j][1] = (k_1 - k_2) * r_d * theta_r[j];
    }
}

/* Eqs. 10, 11, 20 to 22, 52: the current that gives a rate of force. */
static double valve_current(const Actuator *a, const ActuatorState *s, double force_rate,
                            double estimate, double *leakage_effect)
{
    double chamber1 = a->area1 * a->bulk_modulus / (a->volume1 + a->area1 * s->position);
    double chamber2 = a->area2 * a->bulk_modulus / (a->volume2 - a->area2 * s->position);
    double y = s->pressure1 - s->pressure2, root_y = sqrt(fabs(y));
    double leak = a->internal_leakage * y;
    double motion_effect = chamber1 * (a->area1 * s->velocity + leak)
                           + chamber2 * (a->area2 * s->velocity + leak);
    *leakage_effect = (chamber1 + chamber2) * (y < 0.0 ? -root_y : root_y);
    double bracket = motion_effect + *leakage_effect * estimate + force_rate;
    double r_1, r_2;
    if (bracket >= 0.0) {
        r_1 = root(a->supply_pressure - s->pressure1);
        r_2 = root(s->pressure2 - a->return_pressure);
    } else {
        r_1 = root(s->pressure1 - a->return_pressure);
        r_2 = root(a->supply_pressure - s->pressure2);
    }
    double effect = a->flow_gain * a->valve_gain * (chamber1 * r_1 + chamber2 * r_2);
    return bracket / (effect < 1e-9 ? 1e-9 : effect);
}

static void law_step(Law *law, const State *measured, const double theta_r[TERMS], double current[2])
{
    const Surface *surface = &law->model.surface;
    double f[3][2], x[3][2], force[2];
    for (int i = 0; i < 2; i++) {
        const Actuator *a = &law->model.actuator[i];
        const ActuatorState *s = &measured->actuator[i];
        x[0][i] = s->position;
        x[1][i] = s->velocity;
        x[2][i] = law->sample == 0 ? 0.0 : (s->velocity - law->last_velocity[i]) / (1.0 / RATE);
        law->last_velocity[i] = s->velocity;
        force[i] = a->area1 * s->pressure1 - a->area2 * s->pressure2;
    }
    for (int j = 0; j < 3; j++)
        apply(law->t, x[j], f[j]);

    /* Eq. 24 and its derivatives. */
    double y[5] = {measured->angle, measured->rate};
    double r_d = surface->radius;
    double k_h = law->model.actuator[0].connection_stiffness + law->model.actuator[1].connection_stiffness;
    for (int j = 0; j < 3; j++) {
        double load = surface->load_stiffness * r_d * r_d * y[j];
        y[j + 2] = (r_d * f[j][0] - r_d * r_d * k_h * y[j] - surface->damping * y[j + 1] - load)
                   / surface->inertia;
    }
    double x_r[4][2];
    trajectory(law, y, theta_r, x_r);

    /* Eqs. 39 to 55. */
    double z_1[3][2], alpha_1[3][2], z_2[2][2], alpha_2[2][2], z_3[2], wanted[2], force_rate[2];
    for (int j = 0; j < 3; j++)
        for (int i = 0; i < 2; i++) {
            z_1[j][i] = f[j][i] - x_r[j][i];
            alpha_1[j][i] = x_r[j + 1][i] - K_1 * z_1[j][i];
        }
    for (int j = 0; j < 2; j++) {
        double elastic[2], viscous[2], coupling[2];
        const double angle[2] = {y[j], y[j]};
        apply(law->m_1, f[j], elastic);
        apply(law->m_2, f[j + 1], viscous);
        apply(law->m_4, angle, coupling);
        for (int i = 0; i < 2; i++) {
            z_2[j][i] = f[j + 1][i] - alpha_1[j][i];
            alpha_2[j][i] = elastic[i] + viscous[i] - coupling[i] - z_1[j][i] + alpha_1[j + 1][i]
                            - law->velocity_gain * z_2[j][i];
        }
    }
    apply(law->m_3, force, z_3);
    for (int i = 0; i < 2; i++) {
        z_3[i] -= alpha_2[0][i];
        wanted[i] = alpha_2[1][i] - z_2[0][i] - law->force_gain * z_3[i];
    }
    apply(law->m_3_inverse, wanted, force_rate);

    double leakage_effect[2];
    for (int i = 0; i < 2; i++)
        current[i] = valve_current(&law->model.actuator[i], &measured->actuator[i], force_rate[i],
                                   law->estimate[i], &leakage_effect[i]);

    /* Eqs. 59, 60, 67, 68. */
    double v3 = 0.0;
    for (int i = 0; i < 2; i++)
        v3 += 0.5 * (z_1[0][i] * z_1[0][i] + z_2[0][i] * z_2[0][i] + z_3[i] * z_3[i]);
    if (law->sample == 0)
        law->initial_v3 = v3;
    double decay = exp(-law->lambda * (law->sample * (1.0 / RATE)));
    double bound = decay * law->initial_v3 + law->mu / law->lambda * (1.0 - decay);
    if (v3 > bound)
        for (int i = 0; i < 2; i++) {
            double along_z_3 = law->m_3[0][i] * z_3[0] + law->m_3[1][i] * z_3[1];
            double next = law->estimate[i] - LEARNING_RATE * leakage_effect[i] * along_z_3 * (1.0 / RATE);
            law->estimate[i] = next < ESTIMATE_MIN ? ESTIMATE_MIN : next > ESTIMATE_MAX ? ESTIMATE_MAX : next;
        }
    law->sample++;
}

/* The run */

enum { WINDOWS = 3 };

static const double WINDOW[WINDOWS][2] = {{0.0, 7.0}, {7.0, 8.0}, {15.0, 20.0}};

static void look(const Plant *p, const State *s, const double theta_r[TERMS], double t,
                 double tracking[WINDOWS], double fight[WINDOWS])
{
    double x_d = p->surface.radius * s->angle;
    double force[2];
    for (int i = 0; i < 2; i++)
        force[i] = p->actuator[i].connection_stiffness * (s->actuator[i].position - x_d);
    double error = fabs(s->angle - theta_r[0]), difference = fabs(force[0] - force[1]);
    for (int w = 0; w < WINDOWS; w++) {
        if (t < WINDOW[w][0] || t > WINDOW[w][1])
            continue;
        if (error > tracking[w])
            tracking[w] = error;
        if (difference > fight[w])
            fight[w] = difference;
    }
}

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

static void print_list(const char *name, const double *values, int count)
{
    printf(", \"%s\": [", name);
    for (int i = 0; i < count; i++)
        printf("%s%.17g", i == 0 ? "" : ", ", values[i]);
    printf("]");
}

int main(void)
{
    Plant plant = table_1();
    Law law = law_start();
    Vector x = {.x = {0.0}};
    for (int i = 0; i < 2; i++)
        x.s.actuator[i].pressure1 = x.s.actuator[i].pressure2 = 0.5 * plant.actuator[i].supply_pressure;
    double tracking[WINDOWS] = {0.0}, fight[WINDOWS] = {0.0}, theta_r[TERMS], current[2];

    double begin = now();
    for (long step = 0; step < STEPS; step++) {
        double t = step / RATE;
        let_leak(&plant, t);
        stimulus(t, theta_r);
        law_step(&law, &x.s, theta_r, current);
        look(&plant, &x.s, theta_r, t, tracking, fight);
        advance(&plant, t, current, &x.s);
    }
    stimulus(STEPS / RATE, theta_r);
    look(&plant, &x.s, theta_r, STEPS / RATE, tracking, fight);
    double wall_time_s = now() - begin;

    printf("{\"wall_time_s\": %.9f", wall_time_s);
    print_list("measured", x.x, STATES);
    print_list("max_abs_tracking_error_rad", tracking, WINDOWS);
    print_list("max_abs_force_fight_n", fight, WINDOWS);
    print_list("leakage_estimate_m3ps_per_sqrt_pa", law.estimate, 2);
    printf("}\n");
    return 0;
}
