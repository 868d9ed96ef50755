/* 14.1: exact farthest point sampling. Points lie in buckets of such that are near each other; one whose box
   is farther away than its farthest point is from the set cannot change. All distances are integers below
   2**45, exact in binary64. */
#include "nearness.h"

enum { BUCKET = 64 };

typedef struct {
    uint32_t num_buckets;
    const uint32_t *order;      /* [BUCKET * num_buckets]: the last one repeated */
    double *axes[3], *distance; /* likewise: coordinates, squared distance to the set */
    double *low[3], *high[3];   /* [num_buckets]: boxes */
    double *farthest;           /* [num_buckets]: the largest distance */
    double *outside;            /* [num_buckets]: scratch */
} buckets;

static dfcgs_status take_buckets(dfcgs_arena *arena, uint32_t count, buckets *b) {
    b->num_buckets = (count + BUCKET - 1) / BUCKET;
    size_t points = (size_t)b->num_buckets * BUCKET;
    b->distance = DFCGS_TAKE(arena, double, points);
    b->farthest = DFCGS_TAKE(arena, double, b->num_buckets);
    b->outside = DFCGS_TAKE(arena, double, b->num_buckets);
    if (!b->distance || !b->farthest || !b->outside) return DFCGS_MEMORY;
    for (int a = 0; a < 3; a++) {
        b->axes[a] = DFCGS_TAKE(arena, double, points);
        b->low[a] = DFCGS_TAKE(arena, double, b->num_buckets);
        b->high[a] = DFCGS_TAKE(arena, double, b->num_buckets);
        if (!b->axes[a] || !b->low[a] || !b->high[a]) return DFCGS_MEMORY;
    }
    return DFCGS_OK;
}

static void fill_axis(const int32_t *cells, buckets *b, int a) {
    for (uint32_t k = 0; k < b->num_buckets; k++) {
        double *values = b->axes[a] + (size_t)k * BUCKET, low = __builtin_inf(), high = -low;
        for (int i = 0; i < BUCKET; i++) {
            values[i] = cells[3 * (size_t)b->order[(size_t)k * BUCKET + i] + a];
            low = values[i] < low ? values[i] : low;
            high = values[i] > high ? values[i] : high;
        }
        b->low[a][k] = low;
        b->high[a][k] = high;
    }
}

/* Squared distances of the boxes to a point. */
static void measure_boxes(buckets *b, const double point[3]) {
    double *outside = b->outside;
    for (uint32_t k = 0; k < b->num_buckets; k++) {
        double total = 0;
        for (int a = 0; a < 3; a++) {
            double below = b->low[a][k] - point[a], above = point[a] - b->high[a][k];
            double apart = below > above ? below : above;
            apart = apart > 0 ? apart : 0;
            total += apart * apart;
        }
        outside[k] = total;
    }
}

/* Lets the points of bucket k know of a new one. */
static void approach(buckets *b, uint32_t k, const double point[3]) {
    size_t first = (size_t)k * BUCKET;
    const double *x = b->axes[0] + first, *y = b->axes[1] + first, *z = b->axes[2] + first;
    double *distance = b->distance + first, px = point[0], py = point[1], pz = point[2],
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
    b->farthest[k] = low > high ? low : high;
}

/* The first of the points of bucket k at distance `most`. */
static uint32_t first_at(const buckets *b, uint32_t k, double most, uint32_t best) {
    for (size_t i = (size_t)k * BUCKET; i < ((size_t)k + 1) * BUCKET; i++)
        if (b->distance[i] == most && b->order[i] < best) best = b->order[i];
    return best;
}

/* The farthest of all points, the first of equals; UINT32_MAX where all are at distance 0. */
static uint32_t farthest_of(const buckets *b) {
    double most = 0;
    uint32_t best = UINT32_MAX;
    for (uint32_t k = 0; k < b->num_buckets; k++) most = b->farthest[k] > most ? b->farthest[k] : most;
    if (most == 0) return best;
    for (uint32_t k = 0; k < b->num_buckets; k++)
        if (b->farthest[k] == most) best = first_at(b, k, most, best);
    return best;
}

static uint32_t choose(const int32_t *cells, uint32_t wanted, buckets *b, uint32_t *chosen) {
    uint32_t found = 0, next = 0;
    for (uint32_t k = 0; k < b->num_buckets; k++) b->farthest[k] = __builtin_inf();
    for (size_t i = 0; i < (size_t)b->num_buckets * BUCKET; i++) b->distance[i] = __builtin_inf();
    while (next != UINT32_MAX) {
        const int32_t *cell = cells + 3 * (size_t)next;
        double point[3] = {cell[0], cell[1], cell[2]};
        chosen[found++] = next;
        if (found >= wanted) break;
        measure_boxes(b, point);
        for (uint32_t k = 0; k < b->num_buckets; k++)
            if (b->outside[k] < b->farthest[k]) approach(b, k, point);
        next = farthest_of(b);
    }
    return found;
}

dfcgs_status dfcgs_farthest_points(dfcgs_arena *arena, const int32_t *cells, uint32_t count, uint32_t wanted,
                                   uint32_t *chosen, uint32_t *found) {
    size_t mark = arena->used;
    buckets b;
    DFCGS_TRY(take_buckets(arena, count, &b));
    uint32_t *order = DFCGS_TAKE(arena, uint32_t, (size_t)b.num_buckets *BUCKET);
    if (!order) return DFCGS_MEMORY;
    DFCGS_TRY(dfcgs_near_order(arena, cells, count, order));
    for (size_t i = count; i < (size_t)b.num_buckets * BUCKET; i++) order[i] = order[count - 1];
    b.order = order;
    for (int a = 0; a < 3; a++) fill_axis(cells, &b, a);
    *found = choose(cells, wanted, &b, chosen);
    arena->used = mark;
    return DFCGS_OK;
}
