/* 14.1: exact farthest point sampling. Points lie in buckets of such that are near each other, and these in
   crates; one whose box is farther away than its farthest point is from the set cannot change. All distances
   are integers below 2**45, exact in binary64. */
#include "nearness.h"

enum { BUCKET = 64, CRATE = 16 };

/* Boxes of points, and how far the farthest of each is from the set, squared. */
typedef struct {
    uint32_t count;
    double *low[3], *high[3], *farthest; /* [count] */
} boxes;

/* All points: coordinates, squared distances to the set, and which they are; the last one is repeated to fill
 * the last crate. */
typedef struct {
    boxes crates, buckets;
    size_t num_points;
    double *axes[3], *distance;
    uint32_t *order;
} shelves;

static dfcgs_status take_boxes(dfcgs_arena *arena, uint32_t count, boxes *b) {
    b->count = count;
    if (!(b->farthest = DFCGS_TAKE(arena, double, count))) return DFCGS_MEMORY;
    for (int a = 0; a < 3; a++) {
        b->low[a] = DFCGS_TAKE(arena, double, count);
        b->high[a] = DFCGS_TAKE(arena, double, count);
        if (!b->low[a] || !b->high[a]) return DFCGS_MEMORY;
    }
    for (uint32_t k = 0; k < count; k++) b->farthest[k] = __builtin_inf();
    return DFCGS_OK;
}

static dfcgs_status take_shelves(dfcgs_arena *arena, uint32_t count, shelves *s) {
    uint32_t crates = (count - 1) / (BUCKET * CRATE) + 1;
    s->num_points = (size_t)crates * BUCKET * CRATE;
    DFCGS_TRY(take_boxes(arena, crates, &s->crates));
    DFCGS_TRY(take_boxes(arena, crates * CRATE, &s->buckets));
    s->distance = DFCGS_TAKE(arena, double, s->num_points);
    s->order = DFCGS_TAKE(arena, uint32_t, s->num_points);
    if (!s->distance || !s->order) return DFCGS_MEMORY;
    for (int a = 0; a < 3; a++)
        if (!(s->axes[a] = DFCGS_TAKE(arena, double, s->num_points))) return DFCGS_MEMORY;
    for (size_t i = 0; i < s->num_points; i++) s->distance[i] = __builtin_inf();
    return DFCGS_OK;
}

/* The boxes, one axis, of `size` each of what reaches from `low` to `high`. */
static void enclose(const double *low, const double *high, int size, int a, boxes *b) {
    for (uint32_t k = 0; k < b->count; k++, low += size, high += size) {
        b->low[a][k] = low[0];
        b->high[a][k] = high[0];
        for (int i = 1; i < size; i++) {
            b->low[a][k] = low[i] < b->low[a][k] ? low[i] : b->low[a][k];
            b->high[a][k] = high[i] > b->high[a][k] ? high[i] : b->high[a][k];
        }
    }
}

static void fill(const int32_t *cells, shelves *s) {
    for (int a = 0; a < 3; a++) {
        for (size_t i = 0; i < s->num_points; i++) s->axes[a][i] = cells[3 * (size_t)s->order[i] + (size_t)a];
        enclose(s->axes[a], s->axes[a], BUCKET, a, &s->buckets);
        enclose(s->buckets.low[a], s->buckets.high[a], CRATE, a, &s->crates);
    }
}

/* Whether a point is nearer to box k than the farthest of those in it is to the set. */
static int reaches(const boxes *b, uint32_t k, const double point[3]) {
    double total = 0;
    for (int a = 0; a < 3; a++) {
        double below = b->low[a][k] - point[a], above = point[a] - b->high[a][k];
        double apart = below > above ? below : above;
        apart = apart > 0 ? apart : 0;
        total += apart * apart;
    }
    return total < b->farthest[k];
}

/* Lets the points of bucket k know of a new one. */
static void approach_bucket(shelves *s, uint32_t k, const double point[3]) {
    size_t first = (size_t)k * BUCKET;
    const double *x = s->axes[0] + first, *y = s->axes[1] + first, *z = s->axes[2] + first;
    double *distance = s->distance + first, px = point[0], py = point[1], pz = point[2],
           most[4] = {0, 0, 0, 0};
    for (int i = 0; i < BUCKET; i += 4)
        for (int j = 0; j < 4; j++) {
            double dx = x[i + j] - px, dy = y[i + j] - py, dz = z[i + j] - pz,
                   squared = dx * dx + dy * dy + dz * dz;
            double nearer = squared < distance[i + j] ? squared : distance[i + j];
            distance[i + j] = nearer;
            most[j] = nearer > most[j] ? nearer : most[j];
        }
    double low = most[0] > most[1] ? most[0] : most[1], high = most[2] > most[3] ? most[2] : most[3];
    s->buckets.farthest[k] = low > high ? low : high;
}

static void approach_crate(shelves *s, uint32_t k, const double point[3]) {
    double most = 0;
    for (uint32_t j = k * CRATE; j < (k + 1) * CRATE; j++) {
        if (reaches(&s->buckets, j, point)) approach_bucket(s, j, point);
        most = s->buckets.farthest[j] > most ? s->buckets.farthest[j] : most;
    }
    s->crates.farthest[k] = most;
}

/* The first of the points of crate k at distance `most`, if it comes before `best`. */
static uint32_t first_at(const shelves *s, uint32_t k, double most, uint32_t best) {
    for (uint32_t j = k * CRATE; j < (k + 1) * CRATE; j++) {
        if (s->buckets.farthest[j] != most) continue;
        for (size_t i = (size_t)j * BUCKET; i < ((size_t)j + 1) * BUCKET; i++)
            if (s->distance[i] == most && s->order[i] < best) best = s->order[i];
    }
    return best;
}

/* The farthest of all points, the first of equals; UINT32_MAX where all are at distance 0. */
static uint32_t farthest_of(const shelves *s) {
    double most = 0;
    uint32_t best = UINT32_MAX;
    for (uint32_t k = 0; k < s->crates.count; k++)
        most = s->crates.farthest[k] > most ? s->crates.farthest[k] : most;
    if (most == 0) return best;
    for (uint32_t k = 0; k < s->crates.count; k++)
        if (s->crates.farthest[k] == most) best = first_at(s, k, most, best);
    return best;
}

static uint32_t choose(const int32_t *cells, uint32_t wanted, shelves *s, uint32_t *chosen) {
    uint32_t found = 0, next = 0;
    while (next != UINT32_MAX && found < wanted) {
        const int32_t *cell = cells + 3 * (size_t)next;
        double point[3] = {cell[0], cell[1], cell[2]};
        chosen[found++] = next;
        for (uint32_t k = 0; k < s->crates.count; k++)
            if (reaches(&s->crates, k, point)) approach_crate(s, k, point);
        next = farthest_of(s);
    }
    return found;
}

dfcgs_status dfcgs_farthest_points(dfcgs_arena *arena, const int32_t *cells, uint32_t count, uint32_t wanted,
                                   uint32_t *chosen, uint32_t *found) {
    size_t mark = arena->used;
    shelves s;
    DFCGS_TRY(take_shelves(arena, count, &s));
    DFCGS_TRY(dfcgs_near_order(arena, cells, count, s.order));
    for (size_t i = count; i < s.num_points; i++) s.order[i] = s.order[count - 1];
    fill(cells, &s);
    *found = choose(cells, wanted, &s, chosen);
    arena->used = mark;
    return DFCGS_OK;
}
