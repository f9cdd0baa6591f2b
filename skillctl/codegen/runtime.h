/* A skill: from a measured state to the command of a velocity, with the arithmetic of skillctl's controller.
 *
 *     skill_controller controller;
 *     double command[SKILL_DIMENSION];
 *     skill_begin(&controller, 0.001);     once: the period [s], at most SKILL_PERIOD_MAX
 *     controller.max_speed = 0.25;         per second
 *     skill_step(&controller, state, command);     every period
 *
 * C99 and C++17, without allocation; link with -lm. Two skills can be included together. Test it where it is to
 * run: cc -std=c99 -DSKILL_SELFTEST -x c FILE.h -lm && ./a.out
 */
#ifndef SKILL_H_
#define SKILL_H_ /* so that it is included once */

#include <float.h>
#include <math.h>
#include <stddef.h>

#ifdef __FAST_MATH__
#error "The proof, and what is tested, are of arithmetic as C defines it: compile without -ffast-math."
#endif /* of arithmetic */

@FACTS@

#define SKILL_D_ SKILL_DIMENSION
#define SKILL_ROW_ (1 + SKILL_D_ + SKILL_D_ * (SKILL_D_ + 1) / 2)

enum {
    SKILL_OK = 0,
    SKILL_BAD_PERIOD = 1,  /* not positive, or longer than is proved */
    SKILL_BAD_LIMIT = 2,   /* a limit that is not positive */
    SKILL_BAD_STATE = 3,   /* not finite, or beyond 1e100 */
    SKILL_BAD_STAGE = 4    /* a chain has no such stage */
};

#ifndef SKILL_AVERAGED
#define SKILL_AVERAGED 100 /* periods over which commands can be averaged, for a limit of jerk: 2 a / (j period) */
#endif /* of what a program may define before */

/* What is to be kept from one step to the next, and the limits of a command. skill_begin fills it. */
typedef struct {
    double period;                  /* between two steps, [s] */
    double max_speed;               /* per second, in SKILL_UNIT; HUGE_VAL: no limit, as of the next ones */
    double max_acceleration;        /* per second squared; set it, and the jerk, before the first step */
    double max_jerk;                /* per second cubed; needs an acceleration */
#if POSE
    double max_turn;                /* [rad/s] */
    double max_turn_acceleration;   /* [rad/s^2] */
    double max_turn_jerk;           /* [rad/s^3] */
#endif
    int part;                       /* that acted last, from 0; below zero: the next step is a start */
#if CHAIN
    int begin;                      /* the stage that a start begins with, from 0 */
    const char *event;              /* what is due now, such as "close"; NULL: nothing */
    int busy;                       /* set it while the event still goes on; a wait counts by itself */
    int done;                       /* whether the last stage and its events are over */
    int past, due;                  /* events of the stage that are over; periods for which the next one is due */
#endif
    double next[SKILL_DIMENSION];   /* the state that the last command leads to in one period */
#if POSE
    double offset[SKILL_DIMENSION]; /* of that state, from the target */
#endif
    double sent[SKILL_AVERAGED][SKILL_DIMENSION]; /* what was commanded, the newest first, within accelerations */
} skill_controller;

static inline double skill_length_(const double *v, int count)
{
    double square = 0.0;
    int i;
    for (i = 0; i < count; ++i) {
        square += v[i] * v[i];
    }
    return sqrt(square);
}

/* Quadratics of an offset e: each row holds c, l and the upper triangle of Q in c + (l + Q e) . e. */
static inline void skill_quadratics_(const double (*rows)[SKILL_ROW_], int count, const double *offset,
                                     double *values)
{
    double e[SKILL_D_], largest = 0.0, scale, slope;
    const double *row, *q;
    int i, j, k;
    for (i = 0; i < SKILL_D_; ++i) {
        largest = fmax(largest, fabs(offset[i]));
    }
    scale = largest > 1e100 ? 1e100 / largest : 1.0; /* squares would overflow: the direction decides */
    for (i = 0; i < SKILL_D_; ++i) {
        e[i] = scale * offset[i];
    }
    for (k = 0; k < count; ++k) {
        row = rows[k];
        q = row + 1 + SKILL_D_;
        values[k] = 0.0;
        for (i = 0; i < SKILL_D_; ++i) {
            slope = 0.0;
            for (j = i; j < SKILL_D_; ++j) {
                slope += *q++ * e[j];
            }
            values[k] += (slope + row[1 + i]) * e[i];
        }
        values[k] += row[0];
    }
}

/* Turn logarithms into values, the largest one; return their sum. */
static inline double skill_exponentials_(double *values, int count)
{
    double peak = values[0], sum = 0.0;
    int k;
    for (k = 1; k < count; ++k) {
        peak = fmax(peak, values[k]);
    }
    for (k = 0; k < count; ++k) {
        values[k] = exp(values[k] - peak);
        sum += values[k];
    }
    return sum;
}
#if DENSITIES

/* Mixtures side by side, each with a weight. */
typedef struct {
    int mixtures;
    const int *ends; /* of the components of each */
    const double *weights;
    const double *origin;
    const double (*rows)[SKILL_ROW_];
} skill_densities_;

/* The share of each weighted density at a place; each has a place of its own, ``stride`` numbers on. */
static inline void skill_shares_(const skill_densities_ *of, const double *place, int stride, double *shares)
{
    double values[SKILL_TERMS_], offset[SKILL_D_], sum = 0.0;
    int i, k, m;
    for (m = 0, k = 0; m < of->mixtures; ++m) {
        for (i = 0; i < SKILL_D_; ++i) {
            offset[i] = place[stride * m + i] - of->origin[i];
        }
        skill_quadratics_(of->rows + k, of->ends[m] - k, offset, values + k);
        k = of->ends[m];
    }
    skill_exponentials_(values, k);
    for (i = 0, k = 0; i < of->mixtures; ++i) {
        shares[i] = 0.0;
        for (; k < of->ends[i]; ++k) {
            shares[i] += of->weights[i] * values[k];
        }
        sum += shares[i];
    }
    for (i = 0; i < of->mixtures; ++i) {
        shares[i] /= sum;
    }
}
#endif
#if MERGED

/* How the components of merged parts are weighted, from their weights within their own parts. */
typedef struct {
    int first; /* of its components */
    int parts;
    const int *ends; /* of the components of each part */
    const double *weights;
#if EXPERTS
    double sharpness; /* of the gate of experts; zero for another gate */
#endif
#if SHARED
    const skill_densities_ *densities; /* of the gate of densities; NULL for another gate */
#endif
} skill_merger_;

#if SHARED
static inline void skill_merge_(const skill_merger_ *by, const double *place, double *h)
#else
static inline void skill_merge_(const skill_merger_ *by, double *h)
#endif
{
    const double *weights = by->weights;
    int i, k;
#if SHARED
    double shares[SKILL_PARTS_];
    if (by->densities != NULL) {
        skill_shares_(by->densities, place, 0, shares);
        weights = shares;
    }
#endif
#if EXPERTS
    const int end = by->ends[by->parts - 1];
    double peak = 0.0, sum = 0.0;
    if (by->sharpness > 0.0) {
        for (k = by->first; k < end; ++k) {
            peak = fmax(peak, h[k]);
        }
        for (k = by->first; k < end; ++k) {
            h[k] = pow(h[k] / peak, by->sharpness);
        }
    }
#endif
    for (i = 0, k = by->first; i < by->parts; ++i) {
        for (; k < by->ends[i]; ++k) {
            h[k] *= weights[i];
        }
    }
#if EXPERTS
    if (by->sharpness > 0.0) {
        for (k = by->first; k < end; ++k) {
            sum += h[k];
        }
        for (k = by->first; k < end; ++k) {
            h[k] /= sum;
        }
    }
#endif
}
#endif
#if SHEARS

/* y = L x, then one shear after the other: y + a(w . y), a a cubic in each cell. */
typedef struct {
    const double *direction; /* w */
    double per_length, start;
    int cells;
    const double *cubics; /* four coefficients of each coordinate, cell by cell */
    const double *shift;  /* a is zero at zero */
} skill_shear_;

typedef struct {
    const double *linear, *inverse; /* L and its inverse, upper triangular */
    int count;
    const skill_shear_ *shear;
} skill_shears_;

static inline void skill_sheared_(const skill_shear_ *by, int size, double sign, double *y)
{
    double place = 0.0, along;
    const double *p;
    int i, cell;
    for (i = 0; i < size; ++i) {
        place += by->direction[i] * y[i];
    }
    place = place * by->per_length + by->start;
    if (!(place >= 0.0 && place < by->cells)) {
        for (i = 0; i < size; ++i) {
            y[i] -= sign * by->shift[i];
        }
        return;
    }
    cell = (int)place;
    along = place - cell;
    for (i = 0; i < size; ++i) {
        p = by->cubics + 4 * (size * cell + i);
        y[i] += sign * (((p[3] * along + p[2]) * along + p[1]) * along + p[0] - by->shift[i]);
    }
}

static inline void skill_upper_(const double *matrix, int size, double *y)
{
    double sum;
    int i, j;
    for (i = 0; i < size; ++i) { /* what is below is read no more */
        sum = 0.0;
        for (j = i; j < size; ++j) {
            sum += matrix[size * i + j] * y[j];
        }
        y[i] = sum;
    }
}
#endif
#if BODIES

#define SKILL_NUDGE_ 1e-6

static inline double skill_apart_(const double *a, const double *b, int size)
{
    double away = 0.0;
    int i;
    for (i = 0; i < size; ++i) {
        away = hypot(away, a[i] - b[i]);
    }
    return away;
}

/* A rounded convex body: p and Q of u = Q (x - p), the sizes of its core, its rounding and its influence. */
typedef struct {
    const double *pole, *frame;
    int groups;
    const int *ends; /* of the coordinates that are taken together */
    const double *below, *above;
    double rounding, reach;
    double radius; /* of a ball around the pole that holds it */
    const double *exit; /* what is taken for the pole itself */
} skill_body_;

typedef struct {
    double stride; /* how far the state may move near a body, straight */
    int count;
    const skill_body_ *body;
} skill_bodies_;

/* t of sum max(w - t h, 0)^2 = t^2 m^2: how many times the body the offset x - p is away. */
static inline double skill_gauge_(const skill_body_ *body, int size, const double *offset)
{
    double w[SKILL_D_], h[SKILL_D_], ratio[SKILL_D_], u, first, t = 0.0, b = 0.0, c = 0.0, cross = 0.0;
    int order[SKILL_D_], i, j, k, g, over = 0;
    for (g = 0, i = 0; g < body->groups; ++g) {
        w[g] = 0.0;
        first = 0.0;
        for (k = i; i < body->ends[g]; ++i) {
            u = 0.0;
            for (j = 0; j < size; ++j) {
                u += body->frame[size * i + j] * offset[j];
            }
            first = i == k ? u : first;
            w[g] = i == k ? fabs(u) : hypot(w[g], u);
        }
        h[g] = first < 0.0 && body->groups > 1 ? body->below[g] : body->above[g];
        t = fmax(t, w[g] / (h[g] + body->rounding));
    }
    for (g = 0; g < body->groups; ++g) { /* those beyond the core, the farthest first */
        if (w[g] > t * h[g]) {
            ratio[g] = w[g] / (h[g] > 0.0 ? h[g] : 1e-300);
            for (i = over++; i > 0 && ratio[order[i - 1]] < ratio[g]; --i) {
                order[i] = order[i - 1];
            }
            order[i] = g;
        }
    }
    if (over < 2) { /* before a face */
        return t;
    }
    t = 0.0;
    for (k = 0; k < over && ratio[order[k]] > t; ++k) {
        g = order[k];
        for (j = 0; j < k; ++j) {
            u = w[order[j]] * h[g] - w[g] * h[order[j]];
            cross += u * u;
        }
        b += w[g] * h[g];
        c += w[g] * w[g];
        t = c / (b + sqrt(fmax(body->rounding * body->rounding * c - cross, 0.0)));
    }
    return t;
}

/* Lead the position x out of the bodies' poles (opening), or back (not opening). */
static inline void skill_opened_(const skill_bodies_ *bodies, int size, int opening, double *x)
{
    const skill_body_ *body;
    double e[SKILL_D_], t, r, part, reach, square;
    int i, k;
    for (k = 0; k < bodies->count; ++k) {
        body = &bodies->body[k];
        reach = body->reach;
        if (!(skill_apart_(x, body->pole, size) < reach * body->radius)) {
            continue;
        }
        for (i = 0; i < size; ++i) {
            e[i] = x[i] - body->pole[i];
        }
        t = skill_gauge_(body, size, e);
        if (t >= reach) {
            continue;
        }
        square = (reach - 1.0) * (reach - 1.0);
        if (!(t > 0.0)) {
            for (i = 0; i < size; ++i) {
                e[i] = body->exit[i];
            }
            t = SKILL_NUDGE_;
        }
        if (opening) {
            r = fmax(t, SKILL_NUDGE_);
            part = (1.0 + square * r / (reach * reach - r)) / t;
        } else {
            r = t > 1.0 ? reach * reach * (t - 1.0) / (square + t - 1.0) : SKILL_NUDGE_;
            part = fmax(r, SKILL_NUDGE_) / t;
        }
        for (i = 0; i < size; ++i) {
            x[i] = body->pole[i] + part * e[i];
        }
        return; /* influences have no point in common */
    }
}
#endif
#if LINKS

/* One map of the first coordinates of an offset. */
typedef struct {
    int size;
#if SHEARS
    const skill_shears_ *shears;
#endif
#if BODIES
    const skill_bodies_ *bodies;
#endif
} skill_link_;
#endif

typedef struct {
    int components;
    const double (*logits)[SKILL_ROW_];
    const double (*matrices)[SKILL_D_ * SKILL_D_];
    const double *attractor, *anchor;
    const double *lyapunov; /* P of V = y . P y */
#if CHAIN
    int stage;
    double end; /* root of V at which the stage is over */
#endif
#if BACK
    int terms; /* of the density of what it was taught */
    const double *origin;
    const double (*density)[SKILL_ROW_];
#endif
#if MERGED
    int leaves;
    const int *ends; /* of the components of each leaf */
    int mergers;
    const skill_merger_ *merger; /* inner ones first */
#endif
#if LINKS
    int links;
    const skill_link_ *link; /* nearest to the state first */
#endif
} skill_part_;
#if CHAIN

typedef struct {
    const char *name;
    double wait; /* [s]; below zero of all others, which last as long as the caller is busy */
} skill_event_;
#endif
#if STAGES

/* Parts of which one is chosen. */
typedef struct {
    int first, parts;
#if SELECTS
    const skill_densities_ *regions; /* NULL of a single part */
#endif
#if CHAIN
    int events;
    const skill_event_ *event;
#endif
} skill_stage_;
#endif

@TABLES@
/* The velocity at y: a mixture of linear systems around the anchor. */
#if SHARED
static inline void skill_moved_(const skill_part_ *part, const double *y, const double *place,
                                double *velocity)
#else
static inline void skill_moved_(const skill_part_ *part, const double *y, double *velocity)
#endif
{
    double offset[SKILL_D_], h[SKILL_COMPONENTS_], mixed[SKILL_D_ * SKILL_D_], sum;
    int i, j, k;
#if MERGED
    int leaf;
#endif
    for (i = 0; i < SKILL_D_; ++i) {
        offset[i] = y[i] - part->anchor[i];
    }
    skill_quadratics_(part->logits, part->components, offset, h);
#if MERGED
    for (leaf = 0, k = 0; leaf < part->leaves; ++leaf) {
        sum = skill_exponentials_(h + k, part->ends[leaf] - k);
        for (; k < part->ends[leaf]; ++k) {
            h[k] /= sum;
        }
    }
    for (k = 0; k < part->mergers; ++k) {
#if SHARED
        skill_merge_(&part->merger[k], place, h);
#else
        skill_merge_(&part->merger[k], h);
#endif
    }
    sum = 1.0;
#else
    sum = skill_exponentials_(h, part->components);
#endif
    for (i = 0; i < SKILL_D_ * SKILL_D_; ++i) {
        mixed[i] = 0.0;
        for (k = 0; k < part->components; ++k) {
            mixed[i] += h[k] * part->matrices[k][i];
        }
    }
    for (i = 0; i < SKILL_D_; ++i) {
        velocity[i] = 0.0;
        for (j = 0; j < SKILL_D_; ++j) {
            velocity[i] += mixed[SKILL_D_ * i + j] * offset[j];
        }
        velocity[i] /= sum;
    }
}
#if POSE

/* Rotations as vectors (axis times angle) and as quaternions x, y, z, w. */
static inline void skill_quaternion_(const double *vector, double sign, double *q)
{
    double half = 0.5 * skill_length_(vector, 3);
    double scale = 0.5 * sign * (half > 1e-4 ? sin(half) / half : 1.0 - half * half / 6.0);
    q[0] = scale * vector[0];
    q[1] = scale * vector[1];
    q[2] = scale * vector[2];
    q[3] = cos(half);
}

static inline void skill_vector_(const double *q, double *vector)
{
    double sine = skill_length_(q, 3);
    double scale = sine > 0.0 ? 2.0 * atan2(sine, fabs(q[3])) / sine : 2.0;
    int i;
    for (i = 0; i < 3; ++i) {
        vector[i] = (q[3] < 0.0 ? -scale : scale) * q[i];
    }
}

/* The rotation by b, then by a, each of them turned round if its sign is negative. */
static inline void skill_turned_(const double *a, double sign_a, const double *b, double sign_b,
                                 double *vector)
{
    double p[4], q[4], r[4];
    skill_quaternion_(a, sign_a, p);
    skill_quaternion_(b, sign_b, q);
    r[0] = p[3] * q[0] + q[3] * p[0] + p[1] * q[2] - p[2] * q[1];
    r[1] = p[3] * q[1] + q[3] * p[1] + p[2] * q[0] - p[0] * q[2];
    r[2] = p[3] * q[2] + q[3] * p[2] + p[0] * q[1] - p[1] * q[0];
    r[3] = p[3] * q[3] - p[0] * q[0] - p[1] * q[1] - p[2] * q[2];
    skill_vector_(r, vector);
}

/* The state of a hand at a position [m] with a quaternion x, y, z, w of any length and either sign. */
static inline int skill_state_of_pose(const double position[3], const double quaternion[4], double state[6])
{
    int i;
    for (i = 0; i < 3; ++i) {
        state[i] = position[i];
    }
    skill_vector_(quaternion, state + 3);
    return skill_length_(quaternion, 4) > 0.0 ? SKILL_OK : SKILL_BAD_STATE;
}
#endif

/* What leads from one state to another: a velocity times a duration. */
static inline void skill_difference_(const double *to, const double *from, double *difference)
{
    int i;
    for (i = 0; i < SKILL_POSITIONS_; ++i) {
        difference[i] = to[i] - from[i];
    }
#if POSE
    skill_turned_(to + 3, 1.0, from + 3, -1.0, difference + 3);
#endif
}

/* How far apart two states are, in SKILL_UNIT; of poses, one radian counts as SKILL_LENGTH metres. */
static inline double skill_distance(const double a[SKILL_DIMENSION], const double b[SKILL_DIMENSION])
{
    double difference[SKILL_D_];
    skill_difference_(a, b, difference);
#if POSE
    return hypot(skill_length_(difference, 3), SKILL_LENGTH * skill_length_(difference + 3, 3));
#else
    return skill_length_(difference, SKILL_D_);
#endif
}
#if BENT

/* The offset of a state from a target. */
#if POSE
static inline void skill_offset_(const double *state, const double *target, const double *last,
                                 double *offset)
{
    double angle, along, back;
    int i;
    for (i = 0; i < 3; ++i) {
        offset[i] = state[i] - target[i];
    }
    skill_turned_(target + 3, -1.0, state + 3, 1.0, offset + 3);
    angle = skill_length_(offset + 3, 3);
    along = offset[3] * last[3] + offset[4] * last[4] + offset[5] * last[5];
    /* Half a turn away there are two: the side of the last one is kept a little longer. */
    back = angle > SKILL_SEAM_ && along < 0.0 ? 1.0 - SKILL_TURN_ / angle : 1.0;
    for (i = 3; i < 6; ++i) {
        offset[i] *= back;
        offset[i] *= SKILL_LENGTH;
    }
}
#else
static inline void skill_offset_(const double *state, const double *target, double *offset)
{
    skill_difference_(state, target, offset);
}
#endif

static inline void skill_placed_(const double *offset, const double *target, double *state)
{
    int i;
#if POSE
    double turn[3];
    for (i = 0; i < 3; ++i) {
        turn[i] = offset[3 + i] / SKILL_LENGTH;
    }
    skill_turned_(target + 3, 1.0, turn, 1.0, state + 3);
#endif
    for (i = 0; i < SKILL_POSITIONS_; ++i) {
        state[i] = target[i] + offset[i];
    }
}
#endif
#if LINKS

/* Lead an offset x to y. */
static inline void skill_forward_(const skill_part_ *part, double *x)
{
    int i;
#if SHEARS
    int k;
#endif
    for (i = 0; i < part->links; ++i) {
#if BODIES
        if (part->link[i].bodies != NULL) {
            skill_opened_(part->link[i].bodies, part->link[i].size, 0, x);
        }
#endif
#if SHEARS
        if (part->link[i].shears != NULL) {
            skill_upper_(part->link[i].shears->linear, part->link[i].size, x);
            for (k = 0; k < part->link[i].shears->count; ++k) {
                skill_sheared_(&part->link[i].shears->shear[k], part->link[i].size, 1.0, x);
            }
        }
#endif
    }
}
#endif
#if LINKS

/* Lead y back to an offset x. */
static inline void skill_back_(const skill_part_ *part, double *x)
{
    int i;
#if SHEARS
    int k;
#endif
    for (i = part->links - 1; i >= 0; --i) {
#if SHEARS
        if (part->link[i].shears != NULL) {
            for (k = part->link[i].shears->count - 1; k >= 0; --k) {
                skill_sheared_(&part->link[i].shears->shear[k], part->link[i].size, -1.0, x);
            }
            skill_upper_(part->link[i].shears->inverse, part->link[i].size, x);
        }
#endif
#if BODIES
        if (part->link[i].bodies != NULL) {
            skill_opened_(part->link[i].bodies, part->link[i].size, 1, x);
        }
#endif
    }
}
#endif
#if BODIES

/* How far the state may move straight from an offset x. */
static inline double skill_room_(const skill_part_ *part, const double *x)
{
    const skill_body_ *body;
    double room = HUGE_VAL;
    int i;
    if (part->links == 0 || part->link[0].bodies == NULL) {
        return room;
    }
    for (i = 0; i < part->link[0].bodies->count; ++i) {
        body = &part->link[0].bodies->body[i];
        room = fmin(room, skill_apart_(x, body->pole, part->link[0].size) - body->radius);
    }
    return fmax(room, part->link[0].bodies->stride);
}
#endif
#if STAGES

/* The part with which a stage begins: whose region a state lies in. */
static inline int skill_begun_(int stage, const double *state)
{
    const skill_stage_ *of = &skill_stage_table_[stage];
#if SELECTS
    double shares[SKILL_PARTS_];
    int i, best = 0;
#if POSE
    const double none[SKILL_D_] = {0.0};
    double place[SKILL_PARTS_ * SKILL_D_];
    int chart;
    if (of->regions == NULL) {
        return of->first;
    }
    for (chart = 0; chart < of->parts; ++chart) {
        const skill_part_ *part = &skill_part_table_[of->first + chart];
        skill_offset_(state, part->attractor, none, place + SKILL_D_ * chart);
        for (i = 0; i < SKILL_D_; ++i) {
            place[SKILL_D_ * chart + i] += part->anchor[i];
        }
    }
    skill_shares_(of->regions, place, SKILL_D_, shares);
#else
    if (of->regions == NULL) {
        return of->first;
    }
    skill_shares_(of->regions, state, 0, shares);
#endif
    for (i = 1; i < of->parts; ++i) {
        best = shares[i] > shares[best] ? i : best;
    }
    return of->first + best;
#else
    (void)state;
    return of->first;
#endif
}
#endif

/* The largest factor by which a command keeps the limits: below one if it breaks one. */
#if POSE
static inline double skill_allowed_(const double *command, double max_speed, double max_turn)
#else
static inline double skill_allowed_(const double *command, double max_speed)
#endif
{
    double moving = skill_length_(command, SKILL_POSITIONS_);
    double factor = moving > 0.0 ? max_speed / moving : HUGE_VAL;
#if POSE
    double turning = skill_length_(command + 3, 3);
    factor = turning > 0.0 ? fmin(factor, max_turn / turning) : factor;
#endif
    return factor;
}

/* A step of the skill itself: its limits, where it leads, and its command. */
typedef struct {
    double period, max_speed;
    int part;
    double next[SKILL_D_], command[SKILL_D_];
#if POSE
    double max_turn, offset[SKILL_D_];
#endif
} skill_motion_;
#if BENT

/* A step that has begun: y and its velocity. */
typedef struct {
    const skill_part_ *part;
    const double *state;
    double y[SKILL_D_], velocity[SKILL_D_];
    double max_speed;
} skill_start_;

/* Go on for a duration; return by what factor the command keeps the limits. */
static inline double skill_ahead_(const skill_start_ *from, double duration, skill_motion_ *m)
{
    const skill_part_ *part = from->part;
    double x[SKILL_D_];
    int i;
    for (i = 0; i < SKILL_D_; ++i) {
        x[i] = from->y[i] + duration * from->velocity[i];
    }
#if LINKS
    skill_back_(part, x);
#endif
    skill_placed_(x, part->attractor, m->next);
    skill_difference_(m->next, from->state, m->command);
    for (i = 0; i < SKILL_D_; ++i) {
        m->command[i] /= m->period;
#if POSE
        m->offset[i] = x[i];
#endif
    }
#if POSE
    return skill_allowed_(m->command, from->max_speed, m->max_turn);
#else
    return skill_allowed_(m->command, from->max_speed);
#endif
}

/* Step in coordinates: the largest share of the step whose command keeps the limits. */
static inline void skill_bent_(skill_motion_ *m, const double *state)
{
    skill_start_ from;
    const skill_part_ *part = &skill_part_table_[m->part];
    const double aim = 1.0 - 0.5 * SKILL_CLOSE_;
    double x[SKILL_D_], y[SKILL_D_], duration = m->period, share, takes;
    double low = 0.0, high = 1.0, below = -aim, above;
    int i, trial, last = 0;
#if FASTER
    duration *= SKILL_SPEED_;
#endif
#if BODIES
    double factor;
#endif
#if POSE
    skill_offset_(state, part->attractor, m->offset, x);
#else
    skill_offset_(state, part->attractor, x);
#endif
    from.part = part;
    from.state = state;
    from.max_speed = m->max_speed;
    for (i = 0; i < SKILL_D_; ++i) {
        from.y[i] = x[i];
    }
#if BODIES
    from.max_speed = fmin(m->max_speed, skill_room_(part, x) / m->period);
#endif
#if LINKS
    skill_forward_(part, from.y);
#endif
    for (i = 0; i < SKILL_D_; ++i) {
        y[i] = from.y[i] + part->anchor[i];
#if POSE
        x[i] += part->anchor[i];
#endif
    }
#if SHARED
#if POSE
    skill_moved_(part, y, x, from.velocity);
#else
    skill_moved_(part, y, state, from.velocity);
#endif
#else
    skill_moved_(part, y, from.velocity);
#endif
    takes = 1.0 / skill_ahead_(&from, duration, m);
    if (!(takes > 1.0)) {
        return;
    }
    above = takes - aim;
    for (trial = 0; trial < SKILL_TRIALS_; ++trial) { /* regula falsi; the end that stays twice counts half */
        share = (low * above - high * below) / (above - below);
        takes = 1.0 / skill_ahead_(&from, share * duration, m);
        if (takes > 1.0) {
            below *= last > 0 ? 0.5 : 1.0;
            high = share;
            above = takes - aim;
            last = 1;
        } else if (takes < 1.0 - SKILL_CLOSE_) {
            above *= last < 0 ? 0.5 : 1.0;
            low = share;
            below = takes - aim;
            last = -1;
        } else {
            return;
        }
    }
#if BODIES
    factor = skill_ahead_(&from, low * duration, m);
    if (!(low > 0.0) && factor < 1.0) { /* inside a body, and led out of it straight: no longer step is safe */
        for (i = 0; i < SKILL_D_; ++i) {
            m->command[i] *= factor;
            x[i] = m->period * m->command[i];
#if POSE
            m->offset[i] = 0.0;
#endif
        }
        for (i = 0; i < SKILL_POSITIONS_; ++i) {
            m->next[i] = state[i] + x[i];
        }
#if POSE
        skill_turned_(x + 3, 1.0, state + 3, 1.0, m->next + 3);
#endif
    }
#else
    skill_ahead_(&from, low * duration, m);
#endif
}
#endif

/* Take a step of the skill from a state, within the limits of speed. */
static inline void skill_moves_(skill_motion_ *m, const double *state)
{
#if BENT
    skill_bent_(m, state);
#else
    double factor;
    int i;
#if SHARED
    skill_moved_(&skill_part_table_[m->part], state, state, m->command);
#else
    skill_moved_(&skill_part_table_[m->part], state, m->command);
#endif
#if FASTER
    for (i = 0; i < SKILL_D_; ++i) {
        m->command[i] *= SKILL_SPEED_;
    }
#endif
    factor = fmin(skill_allowed_(m->command, m->max_speed), 1.0);
    for (i = 0; i < SKILL_D_; ++i) {
        m->command[i] *= factor;
        m->next[i] = state[i] + m->period * m->command[i];
    }
#endif
}

/* Where a state is led by a factor times a command. */
static inline void skill_displaced_(const double *state, double factor, const double *command, double *to)
{
    int i;
#if POSE
    double turn[3];
    for (i = 0; i < 3; ++i) {
        turn[i] = factor * command[3 + i];
    }
    skill_turned_(turn, 1.0, state + 3, 1.0, to + 3);
#endif
    for (i = 0; i < SKILL_POSITIONS_; ++i) {
        to[i] = state[i] + factor * command[i];
    }
}

/* y of a state, whatever side of half a turn it is on. */
static inline void skill_lifted_(const skill_part_ *part, const double *state, double *y)
{
#if POSE
    const double none[SKILL_D_] = {0.0};
    skill_offset_(state, part->attractor, none, y);
#else
    skill_difference_(state, part->attractor, y);
#endif
#if LINKS
    skill_forward_(part, y);
#endif
}

/* The root of V. */
static inline double skill_size_(const skill_part_ *part, const double *y)
{
    double v = 0.0, row;
    int i, j;
    for (i = 0; i < SKILL_D_; ++i) {
        row = 0.0;
        for (j = 0; j < SKILL_D_; ++j) {
            row += part->lyapunov[SKILL_D_ * i + j] * y[j];
        }
        v += y[i] * row;
    }
    return sqrt(v);
}
#if CHAIN

/* Whether the stage of a part is over: V is at its level or below. */
static inline int skill_over_(int index, const double *state)
{
    double y[SKILL_D_];
    skill_lifted_(&skill_part_table_[index], state, y);
    return skill_size_(&skill_part_table_[index], y) <= skill_part_table_[index].end;
}
#if BACK

/* How familiar a stage is with a state: the logarithm of its largest density. */
static inline double skill_familiarity_(int stage, const double *state)
{
    const skill_stage_ *of = &skill_stage_table_[stage];
    const skill_part_ *part;
    double values[SKILL_TERMS_], offset[SKILL_D_], best = -HUGE_VAL, peak, sum;
    int i, k;
#if POSE
    const double none[SKILL_D_] = {0.0};
#endif
    for (k = of->first; k < of->first + of->parts; ++k) {
        part = &skill_part_table_[k];
#if POSE
        skill_offset_(state, part->attractor, none, offset);
        for (i = 0; i < SKILL_D_; ++i) {
            offset[i] += part->anchor[i] - part->origin[i];
        }
#else
        for (i = 0; i < SKILL_D_; ++i) {
            offset[i] = state[i] - part->origin[i];
        }
#endif
        skill_quadratics_(part->density, part->terms, offset, values);
        peak = values[0];
        for (i = 1; i < part->terms; ++i) {
            peak = fmax(peak, values[i]);
        }
        sum = skill_exponentials_(values, part->terms);
        best = fmax(best, peak + log(sum));
    }
    return best;
}
#endif

static inline void skill_course_begin_(skill_controller *c)
{
    c->event = NULL;
    c->done = c->past = c->due = 0;
}

/* The part that acts next: where a stage is over, its events come first, then the next stage. */
static inline int skill_onward_(skill_controller *c, const double *state, int part)
{
    const skill_stage_ *stage;
    double wait;
    int busy = c->busy, index;
    while (skill_over_(part, state)) { /* at most once for each stage */
        index = skill_part_table_[part].stage;
        stage = &skill_stage_table_[index];
        if (c->due > 0) {
            wait = stage->event[c->past].wait;
            if (!(wait < 0.0 ? busy : c->due < wait / c->period - SKILL_ROUNDING_)) {
                ++c->past;
                c->due = 0;
            }
        }
        c->event = c->past < stage->events ? stage->event[c->past].name : NULL;
        if (c->event != NULL) {
            ++c->due;
            break;
        }
        if (index + 1 == SKILL_STAGES) {
            c->done = 1;
            break;
        }
        part = skill_begun_(index + 1, state);
        busy = 0;
        skill_course_begin_(c);
    }
    return part;
}
#endif

/* --- Limits of acceleration and jerk: see skillctl/model/limits.py, whose arithmetic this is. ------------- */

/* In how many periods, a fraction, a command can change so. */
static inline double skill_change_(const skill_controller *c, const double *change)
{
    double size = skill_length_(change, SKILL_POSITIONS_) / (c->max_acceleration * c->period);
#if POSE
    size = fmax(size, skill_length_(change + 3, 3) / (c->max_turn_acceleration * c->period));
#endif
    return size;
}

/* In how many periods a command can be brought to zero, at least one. */
static inline double skill_periods_(const skill_controller *c, const double *command)
{
    return fmax(1.0, ceil(skill_change_(c, command) * (1.0 - SKILL_WHOLE_)));
}

/* Over how many periods commands are averaged. */
static inline double skill_averaged_(const skill_controller *c)
{
    double longest = c->max_jerk <= DBL_MAX ? 2.0 * c->max_acceleration / c->max_jerk : 0.0;
#if POSE
    if (c->max_turn_jerk <= DBL_MAX) {
        longest = fmax(longest, 2.0 * c->max_turn_acceleration / c->max_turn_jerk);
    }
#endif
    return fmax(1.0, ceil(longest / c->period - SKILL_WHOLE_));
}

static inline int skill_ramps_(const skill_controller *c)
{
#if POSE
    return c->max_acceleration <= DBL_MAX || c->max_turn_acceleration <= DBL_MAX;
#else
    return c->max_acceleration <= DBL_MAX;
#endif
}

/* Whether nothing is commanded any more. */
static inline int skill_resting(const skill_controller *c)
{
    int i, k;
    for (k = 0; k < SKILL_AVERAGED; ++k) {
        for (i = 0; i < SKILL_DIMENSION; ++i) {
            if (c->sent[k][i] != 0.0) {
                return 0;
            }
        }
    }
    return 1;
}

/* Remember a command, and replace it by the average that is sent. */
static inline void skill_send_(skill_controller *c, double *command)
{
    const int count = (int)skill_averaged_(c);
    int i, k;
    for (i = 0; i < SKILL_DIMENSION; ++i) {
        for (k = count - 1; k > 0; --k) {
            c->sent[k][i] = c->sent[k - 1][i];
        }
        c->sent[0][i] = command[i];
        for (k = 1; k < count; ++k) {
            command[i] += c->sent[k][i];
        }
        command[i] /= count;
    }
}

/* Between which factors of a vector it is within a distance of another one; an empty range if it never is. */
static inline void skill_chord_(const double *along, const double *centre, int count, double radius,
                                double *low, double *high)
{
    double square = 0.0, product = 0.0, size = 0.0, room;
    int i;
    for (i = 0; i < count; ++i) {
        square += along[i] * along[i];
        product += along[i] * centre[i];
        size += centre[i] * centre[i];
    }
    room = product * product - square * (size - radius * radius);
    if (!(square > 0.0) ? sqrt(size) > radius : room < 0.0) {
        *low = 1.0;
        *high = 0.0;
    } else if (square > 0.0) {
        *low = fmax(*low, (product - sqrt(room)) / square);
        *high = fmin(*high, (product + sqrt(room)) / square);
    }
}

/* Replace a command by the longest along it that one period allows, and write the shortest; or both as the
 * nearest to any. */
static inline void skill_along_(const skill_controller *c, double *wanted, double *shortest)
{
    const double *last = c->sent[0];
    double weight, low = 0.0, high = 1.0, along = 0.0, square = 0.0, change[SKILL_D_], size;
    int i;
    if (c->max_acceleration <= DBL_MAX) {
        skill_chord_(wanted, last, SKILL_POSITIONS_, c->max_acceleration * c->period, &low, &high);
    }
#if POSE
    if (c->max_turn_acceleration <= DBL_MAX) {
        skill_chord_(wanted + 3, last + 3, 3, c->max_turn_acceleration * c->period, &low, &high);
    }
#endif
    if (low <= high) {
        for (i = 0; i < SKILL_D_; ++i) {
            shortest[i] = low * wanted[i];
            wanted[i] *= high;
        }
        return;
    }
    for (i = 0; i < SKILL_D_; ++i) {
        weight = 1.0 / (c->max_acceleration * c->period);
#if POSE
        weight = i < 3 ? weight : 1.0 / (c->max_turn_acceleration * c->period);
#endif
        along += weight * wanted[i] * (weight * last[i]);
        square += weight * wanted[i] * (weight * wanted[i]);
    }
    along = fmin(1.0, fmax(0.0, along / square));
    for (i = 0; i < SKILL_D_; ++i) {
        change[i] = along * wanted[i] - last[i];
    }
    size = skill_change_(c, change);
    for (i = 0; i < SKILL_D_; ++i) {
        shortest[i] = wanted[i] = last[i] + change[i] / size;
    }
}

static inline void skill_braked_(const skill_controller *c, double *command)
{
    const double keep = 1.0 - 1.0 / skill_periods_(c, c->sent[0]);
    int i;
    for (i = 0; i < SKILL_D_; ++i) {
        command[i] = c->sent[0][i] * keep;
    }
}

/* Whether the stop of a command falls from y as it has to, and the straight way there is free. */
static inline int skill_stops_(const skill_controller *c, const skill_part_ *part, const double *state,
                               const double *command, const double *here, double share, double room)
{
    double stop[SKILL_D_], y[SKILL_D_], change[SKILL_D_];
    int i;
#if BODIES
    double end[SKILL_D_], outside[SKILL_D_];
#if POSE
    const double none[SKILL_D_] = {0.0};
#endif
#endif
    skill_displaced_(state, 0.5 * (skill_periods_(c, command) + 1.0) * c->period, command, stop);
    skill_lifted_(part, stop, y);
    for (i = 0; i < SKILL_D_; ++i) {
        change[i] = y[i] - here[i];
    }
    if (share > 0.0 &&
        !(skill_size_(part, here) - skill_size_(part, y) >= share * skill_size_(part, change))) {
        return 0;
    }
    if (!(room < HUGE_VAL)) {
        return 1;
    }
#if BODIES
#if POSE
    skill_offset_(stop, part->attractor, none, end);
#else
    skill_offset_(stop, part->attractor, end);
#endif
    for (i = 0; i < SKILL_D_; ++i) {
        outside[i] = y[i];
    }
    skill_back_(part, outside);
    for (i = 0; i < SKILL_D_; ++i) {
        outside[i] -= end[i];
    }
    skill_difference_(stop, state, change);
    return skill_length_(change, SKILL_POSITIONS_) <= room &&
           skill_length_(outside, SKILL_D_) <= SKILL_CLOSED_ * skill_length_(end, SKILL_D_);
#else
    return 1;
#endif
}

/* Change the command of a step that the skill would like to do, while the robot moves. */
static inline void skill_eased_(const skill_controller *c, const double *state, skill_motion_ *m)
{
    const skill_part_ *part = &skill_part_table_[m->part];
    skill_motion_ onward = *m;
    double braked[SKILL_D_], wanted[SKILL_D_], stop[SKILL_D_], here[SKILL_D_], y[SKILL_D_], change[SKILL_D_];
    double shortest[SKILL_D_], refused[SKILL_D_], size, ease, share, room = HUGE_VAL;
    const double *good = braked, *bad = wanted;
    int i, halvings, still = 1;
#if BODIES
    double end[SKILL_D_];
#if POSE
    const double none[SKILL_D_] = {0.0};
#endif
#endif
    skill_braked_(c, braked);
    for (i = 0; i < SKILL_D_; ++i) {
        still = still && m->command[i] == 0.0;
        wanted[i] = m->command[i];
        m->command[i] = braked[i];
    }
    if (still) {
        return;
    }
#if RESELECTS
    onward.part = skill_begun_(0, m->next);
#endif
    skill_moves_(&onward, m->next);
    for (i = 0; i < SKILL_D_; ++i) {
        change[i] = onward.command[i] - wanted[i];
    }
    size = skill_change_(c, change);
    ease = size > 0.0 ? fmin(1.0, sqrt(SKILL_FOLLOWING_ / size)) : 1.0;
    for (i = 0; i < SKILL_D_; ++i) {
        wanted[i] *= ease;
    }
    skill_along_(c, wanted, shortest);
    /* The stop has to fall as along the skill's own step, or a share of that. */
    skill_lifted_(part, state, here);
    skill_lifted_(part, m->next, y);
    share = skill_size_(part, here) - skill_size_(part, y);
    for (i = 0; i < SKILL_D_; ++i) {
        change[i] = y[i] - here[i];
    }
    size = skill_size_(part, change);
    share = size > 0.0 ? SKILL_DESCENT_ * share / size : 0.0;
    skill_displaced_(state, 0.5 * (skill_periods_(c, c->sent[0]) - 1.0) * c->period, c->sent[0], stop);
    skill_lifted_(part, stop, here);
#if BODIES
#if POSE
    skill_offset_(state, part->attractor, none, end);
#else
    skill_offset_(state, part->attractor, end);
#endif
    room = skill_room_(part, end);
#endif
    /* The longest, or else the last that is allowed between the shortest, or braking, and one that is not. */
    if (skill_stops_(c, part, state, wanted, here, share, room)) {
        good = wanted;
    } else if (skill_stops_(c, part, state, shortest, here, share, room)) {
        good = shortest;
        bad = wanted;
    } else {
        bad = shortest;
    }
    for (i = 0; i < SKILL_D_; ++i) {
        m->command[i] = good[i];
    }
    for (halvings = 0; good != wanted && halvings < SKILL_HALVINGS_; ++halvings) {
        for (i = 0; i < SKILL_D_; ++i) {
            change[i] = 0.5 * (m->command[i] + bad[i]);
        }
        if (skill_stops_(c, part, state, change, here, share, room)) {
            for (i = 0; i < SKILL_D_; ++i) {
                m->command[i] = change[i];
            }
        } else {
            for (i = 0; i < SKILL_D_; ++i) {
                refused[i] = change[i];
            }
            bad = refused;
        }
    }
}

static inline void skill_start_anew_(skill_controller *c, int stage)
{
    c->part = -1;
#if CHAIN
    c->begin = stage;
    skill_course_begin_(c);
#else
    (void)stage;
#endif
}

/* Forget which part acts, and what was commanded: the next step is a start from rest. */
static inline void skill_reset(skill_controller *c)
{
    int i, k;
    for (k = 0; k < SKILL_AVERAGED; ++k) {
        for (i = 0; i < SKILL_DIMENSION; ++i) {
            c->sent[k][i] = 0.0;
        }
    }
    skill_start_anew_(c, 0);
}

/* Write the next command of a straight way to rest, within the limits of acceleration and jerk. */
static inline void skill_brake(skill_controller *c, double command[SKILL_DIMENSION])
{
    double from[SKILL_DIMENSION];
    int i;
    for (i = 0; i < SKILL_DIMENSION; ++i) {
        command[i] = 0.0;
        from[i] = c->next[i];
    }
    if (skill_ramps_(c)) {
        skill_braked_(c, command);
        skill_send_(c, command);
    }
    skill_displaced_(from, c->period, command, c->next);
}
#if CHAIN

/* Begin a stage, from 0, at the next step: anew, or as one that takes what was lost. */
static inline int skill_go(skill_controller *c, int stage)
{
    if (stage < 0 || stage >= SKILL_STAGES) {
        return SKILL_BAD_STAGE;
    }
    skill_start_anew_(c, stage);
    return SKILL_OK;
}

/* The stage that acted last, from 0; below zero before the first step. */
static inline int skill_stage(const skill_controller *c)
{
    return c->part < 0 ? -1 : skill_part_table_[c->part].stage;
}
#endif

/* Make a controller without limits, for a period that may be longer than SKILL_PERIOD_MAX: nothing is proved
 * of it. */
static inline int skill_begin_unproved(skill_controller *c, double period)
{
    int i;
    c->period = period > 0.0 && period <= DBL_MAX ? period : 0.0;
    c->max_speed = c->max_acceleration = c->max_jerk = HUGE_VAL;
#if POSE
    c->max_turn = c->max_turn_acceleration = c->max_turn_jerk = HUGE_VAL;
#endif
#if CHAIN
    c->busy = 0;
#endif
    for (i = 0; i < SKILL_DIMENSION; ++i) {
        c->next[i] = 0.0;
#if POSE
        c->offset[i] = 0.0;
#endif
    }
    skill_reset(c);
    return c->period > 0.0 ? SKILL_OK : SKILL_BAD_PERIOD;
}

/* Make a controller without limits, for a period [s] that is proved; with another one every step is refused. */
static inline int skill_begin(skill_controller *c, double period)
{
    return skill_begin_unproved(c, period <= SKILL_PERIOD_MAX ? period : 0.0);
}

/* Write the command for a measured state, per second: what to follow until the next step, one period on.
 *
 * If it returns anything but SKILL_OK, the command is zero and the controller is as before. */
static inline int skill_step(skill_controller *c, const double state[SKILL_DIMENSION],
                             double command[SKILL_DIMENSION])
{
    skill_motion_ m;
    double ahead[SKILL_DIMENSION];
    int i, k, part, averaged, moving = 0, ramps;
#if CHAIN
    int stage;
#endif
#if BACK
    double best, familiarity;
#endif
    for (i = 0; i < SKILL_DIMENSION; ++i) {
        command[i] = 0.0;
    }
    if (!(c->period > 0.0)) {
        return SKILL_BAD_PERIOD;
    }
    if (!(c->max_speed > 0.0 && c->max_acceleration > 0.0 && c->max_jerk > 0.0)) {
        return SKILL_BAD_LIMIT;
    }
#if POSE
    if (!(c->max_turn > 0.0 && c->max_turn_acceleration > 0.0 && c->max_turn_jerk > 0.0)) {
        return SKILL_BAD_LIMIT;
    }
#endif
    if (!(skill_averaged_(c) <= SKILL_AVERAGED)) { /* or a jerk without an acceleration */
        return SKILL_BAD_LIMIT;
    }
    averaged = (int)skill_averaged_(c);
    ramps = skill_ramps_(c);
    for (i = 0; i < SKILL_DIMENSION; ++i) {
        if (!(fabs(state[i]) <= 1e100)) {
            return SKILL_BAD_STATE;
        }
    }
    part = c->part;
#if STAGES
    if (part < 0 || skill_distance(state, c->next) > SKILL_DISTURBANCE) {
#if CHAIN
        stage = part < 0 ? c->begin : skill_part_table_[part].stage;
#if BACK
        if (part >= 0) {
            best = skill_familiarity_(stage, state);
            for (i = stage - 1; i >= 0; --i) {
                familiarity = skill_familiarity_(i, state);
                stage = familiarity > best ? i : stage;
                best = fmax(familiarity, best);
            }
        }
#endif
        part = skill_begun_(stage, state);
        skill_course_begin_(c);
#else
        part = -1; /* chosen where the robot will be */
#endif
#else
    if (part < 0) {
        part = 0;
#endif
#if POSE
        for (i = 0; i < SKILL_DIMENSION; ++i) {
            c->offset[i] = 0.0;
        }
#endif
    }
#if CHAIN
    stage = part;
    part = skill_onward_(c, state, part);
#if POSE
    for (i = 0; part != stage && i < SKILL_DIMENSION; ++i) {
        c->offset[i] = 0.0;
    }
#endif
#endif
    m.period = c->period;
    m.max_speed = c->max_speed;
#if POSE
    m.max_turn = c->max_turn;
    for (i = 0; i < SKILL_DIMENSION; ++i) {
        m.offset[i] = c->offset[i];
    }
#endif
    for (i = 0; i < SKILL_DIMENSION; ++i) {
        ahead[i] = state[i];
        moving = moving || c->sent[0][i] != 0.0;
    }
    if (ramps) {
        for (i = 0; i < SKILL_DIMENSION; ++i) {
            command[i] = 0.0;
            for (k = 0; k < averaged; ++k) {
                command[i] += (averaged - 1 - k) * (c->period / averaged) * c->sent[k][i];
            }
        }
        if (averaged > 1) {
            skill_displaced_(state, 1.0, command, ahead);
        }
        if (!moving) { /* from rest: what one period reaches */
            m.max_speed = fmin(m.max_speed, c->max_acceleration * c->period);
#if POSE
            m.max_turn = fmin(m.max_turn, c->max_turn_acceleration * c->period);
#endif
        }
    }
#if STAGES
#if RESELECTS
    part = skill_begun_(0, ahead);
#else
    part = part < 0 ? skill_begun_(0, ahead) : part;
#endif
#endif
    c->part = part;
    m.part = part;
    skill_moves_(&m, ahead);
    if (ramps) {
        if (moving) {
            skill_eased_(c, ahead, &m);
        }
        skill_send_(c, m.command);
        skill_displaced_(state, c->period, m.command, m.next);
    }
    for (i = 0; i < SKILL_DIMENSION; ++i) {
        command[i] = m.command[i];
        c->next[i] = m.next[i];
#if POSE
        c->offset[i] = m.offset[i];
#endif
    }
    return SKILL_OK;
}

/* How far the nearest target is from a state; see skill_distance. */
static inline double skill_remaining(const double state[SKILL_DIMENSION])
{
    double nearest = HUGE_VAL;
    int i;
    for (i = 0; i < SKILL_TARGETS; ++i) {
        nearest = fmin(nearest, skill_distance(state, skill_targets[i]));
    }
    return nearest;
}
@ALIASES@
#ifdef SKILL_SELFTEST

#include <stdio.h>

/* States, and what is commanded there by a controller that has just begun. */
static const struct {
#if POSE
    double max_speed, max_turn;
#else
    double max_speed;
#endif
    double state[SKILL_DIMENSION], command[SKILL_DIMENSION];
} skill_tests_[] = {
@TESTS@
};

int main(void)
{
    const int count = (int)(sizeof skill_tests_ / sizeof skill_tests_[0]);
    double command[SKILL_DIMENSION], error[SKILL_DIMENSION], allowed;
    skill_controller controller;
    int i, k, bad = 0;
#if POSE
    const double unturned[4] = {0.0, 0.0, 0.0, -2.0};
    bad += skill_state_of_pose(skill_targets[0], unturned, error) != SKILL_OK || error[3] != 0.0;
#endif
    bad += skill_begin(&controller, 2.0 * SKILL_PERIOD_MAX) == SKILL_OK;
#if CHAIN
    bad += skill_go(&controller, SKILL_STAGES) == SKILL_OK || skill_stage(&controller) >= 0;
#endif
    bad += !(skill_remaining(skill_targets[0]) < 1e-9);
    skill_brake(&controller, command);
    bad += !skill_resting(&controller);
    for (k = 0; k < count; ++k) {
        skill_begin_unproved(&controller, SKILL_TEST_PERIOD);
        controller.max_speed = skill_tests_[k].max_speed;
#if POSE
        controller.max_turn = skill_tests_[k].max_turn;
#endif
        if (skill_step(&controller, skill_tests_[k].state, command) != SKILL_OK) {
            ++bad;
            continue;
        }
        for (i = 0; i < SKILL_DIMENSION; ++i) {
            error[i] = command[i] - skill_tests_[k].command[i];
        }
        allowed = SKILL_TEST_RELATIVE * skill_length_(skill_tests_[k].command, SKILL_DIMENSION)
#if BENT
            + SKILL_TEST_ABSOLUTE * skill_length_(skill_tests_[k].state, SKILL_DIMENSION) / SKILL_TEST_PERIOD
#endif
            ;
        bad += !(skill_length_(error, SKILL_DIMENSION) <= allowed);
    }
    printf("%d of %d commands are those of the skill\n", count - bad, count);
    return bad > 0;
}

#endif /* SKILL_SELFTEST */
#endif /* SKILL_H_ */
