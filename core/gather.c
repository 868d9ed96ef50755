/* 14.2: the nearest control points of each point. Points that are near each other share the control points
   that can be among the nearest of any of them: those no farther from the box of all of them than as many
   others are at most. */
#include "nearness.h"

enum { MAX_ASKED = DFCGS_NUM_GATHERED + 1, WEIGHT_BITS = 12, RADIUS_BITS = 10 };
/* points are split into parts of so many, these into smaller ones */
enum { NUM_SPLITS = 3 };
static const uint32_t part_sizes[NUM_SPLITS] = {2048, 256, 32};

/* Coordinates fit binary32 exactly, squared distances but for a part in 2**21; who is looked at more closely
   is settled with such ones and this margin, so that nobody is missed. Who is nearest is settled with exact
   ones. */
static const float margin = 1 + 1.0f / (1 << 16);

/* Control points by rank, rising. */
typedef struct {
    uint32_t count;
    float *axes[3];
    uint16_t *ranks;
} candidates;

typedef struct {
    float low[3], high[3];
} box;

/* The `asked` smallest of what was seen, the first of equals first, and what they belong to. */
typedef struct {
    int asked;
    double distance[MAX_ASKED];
    uint32_t rank[MAX_ASKED];
} nearest;

static nearest nobody(int asked) {
    nearest found = {.asked = asked};
    for (int k = 0; k < asked; k++) found.distance[k] = __builtin_inf();
    return found;
}

static void see(nearest *found, double distance, uint32_t rank) {
    int k = found->asked - 1;
    for (; k > 0 && found->distance[k - 1] > distance; k--) {
        found->distance[k] = found->distance[k - 1];
        found->rank[k] = found->rank[k - 1];
    }
    found->distance[k] = distance;
    found->rank[k] = rank;
}

static dfcgs_status take_candidates(dfcgs_arena *arena, uint32_t most, candidates *some) {
    some->count = 0;
    some->ranks = DFCGS_TAKE(arena, uint16_t, (size_t)most + 1);
    for (int a = 0; a < 3; a++)
        if (!(some->axes[a] = DFCGS_TAKE(arena, float, (size_t)most + 1))) return DFCGS_MEMORY;
    return some->ranks ? DFCGS_OK : DFCGS_MEMORY;
}

static box box_of(const int32_t *cells, const uint32_t *order, uint32_t count) {
    box b;
    for (int a = 0; a < 3; a++) {
        int32_t low = INT32_MAX, high = INT32_MIN;
        for (uint32_t i = 0; i < count; i++) {
            int32_t value = cells[3 * (size_t)order[i] + (size_t)a];
            low = value < low ? value : low;
            high = value > high ? value : high;
        }
        b.low[a] = (float)low;
        b.high[a] = (float)high;
    }
    return b;
}

static float larger(float a, float b) { return a > b ? a : b; }

/* Squared distances of the candidates to the nearest and to the farthest place in a box. */
static void measure(const candidates *from, const box *b, float *restrict near, float *restrict far) {
    const float *xs = from->axes[0], *ys = from->axes[1], *zs = from->axes[2];
    for (uint32_t c = 0; c < from->count; c++) {
        float left = b->low[0] - xs[c], right = xs[c] - b->high[0], dx = larger(larger(left, right), 0);
        float under = b->low[1] - ys[c], above = ys[c] - b->high[1], dy = larger(larger(under, above), 0);
        float front = b->low[2] - zs[c], behind = zs[c] - b->high[2], dz = larger(larger(front, behind), 0);
        float ex = larger(-left, -right), ey = larger(-under, -above), ez = larger(-front, -behind);
        near[c] = dx * dx + dy * dy + dz * dz;
        far[c] = ex * ex + ey * ey + ez * ez;
    }
}

/* The places of values that are not above `bound`; `places` [count + 1]. Without a branch, which nobody could
 * predict. */
static uint32_t not_above(const float *values, uint32_t count, float bound, uint32_t *places) {
    uint32_t found = 0;
    for (uint32_t c = 0; c < count; c++) {
        places[found] = c;
        found += values[c] <= bound;
    }
    return found;
}

/* The largest of the `asked` smallest values. */
static float bound_of(const float *values, uint32_t count, int asked) {
    nearest found = nobody(asked);
    float bound = __builtin_inff();
    for (uint32_t c = 0; c < count; c++) {
        if (values[c] >= bound) continue;
        see(&found, values[c], c);
        bound = (float)found.distance[asked - 1];
    }
    return bound;
}

/* What the search of one call works on; `lists[d]` are the candidates of a part after d splits. */
typedef struct {
    const int32_t *cells, *control;
    dfcgs_binding *bindings;
    int asked;
    float *near, *far;
    uint32_t *close;
    candidates lists[1 + NUM_SPLITS];
} search;

/* Those of `from` that can be among the nearest of a point in the box. */
static void select(search *s, const candidates *from, const box *b, candidates *to) {
    measure(from, b, s->near, s->far);
    to->count = not_above(s->near, from->count, bound_of(s->far, from->count, s->asked) * margin, s->close);
    for (uint32_t j = 0; j < to->count; j++) {
        uint32_t c = s->close[j];
        for (int a = 0; a < 3; a++) to->axes[a][j] = from->axes[a][c];
        to->ranks[j] = from->ranks[c];
    }
}

static void measure_point(const candidates *from, const int32_t *cell, float *restrict squared) {
    const float *xs = from->axes[0], *ys = from->axes[1], *zs = from->axes[2];
    float x = (float)cell[0], y = (float)cell[1], z = (float)cell[2];
    for (uint32_t c = 0; c < from->count; c++) {
        float dx = xs[c] - x, dy = ys[c] - y, dz = zs[c] - z;
        squared[c] = dx * dx + dy * dy + dz * dz;
    }
}

/* The exact squared distance of a candidate; below 2**45. */
static double distance_to(const search *s, const candidates *from, uint32_t c, const int32_t *cell) {
    const int32_t *control = s->control + 3 * (size_t)from->ranks[c];
    int64_t x = control[0] - cell[0], y = control[1] - cell[1], z = control[2] - cell[2];
    return (double)(x * x + y * y + z * z);
}

/* The nearest of `from` to a cell: `found` were so before, and the farthest of them is an upper bound now. */
static void find_nearest(search *s, const candidates *from, const int32_t *cell, nearest *found) {
    float bound = 0;
    measure_point(from, cell, s->near);
    for (int k = 0; k < s->asked; k++) bound = larger(bound, s->near[found->rank[k]]);
    uint32_t close = not_above(s->near, from->count, bound * margin, s->close);
    *found = nobody(s->asked);
    for (uint32_t j = 0; j < close; j++) {
        double distance = distance_to(s, from, s->close[j], cell);
        if (distance < found->distance[s->asked - 1]) see(found, distance, s->close[j]);
    }
}

/* Weights (1 - d / edge)**2, where the edge is the distance of the fifth nearest. All are integers below
   2**53, and the quotient of such never rounds up to an integer. */
static void bind(const nearest *found, const uint16_t *ranks, dfcgs_binding *binding) {
    int count = found->asked < DFCGS_NUM_GATHERED ? found->asked : DFCGS_NUM_GATHERED, sum = 0;
    double distance[MAX_ASKED], square[DFCGS_NUM_GATHERED] = {0}, total = 0;
    for (int k = 0; k < MAX_ASKED; k++) distance[k] = __builtin_floor(__builtin_sqrt(found->distance[k]));
    double last = distance[found->asked - 1], edge = found->asked > count ? last : 2 * last;
    edge = edge > 1 ? edge : 1;
    for (int k = 0; k < count; k++) {
        double reach = (1 << RADIUS_BITS) - __builtin_floor(distance[k] * (1 << RADIUS_BITS) / edge);
        total += square[k] = reach * reach;
    }
    total = total > 1 ? total : 1;
    *binding = (dfcgs_binding){.choice = DFCGS_BLEND};
    for (int k = 0; k < DFCGS_NUM_GATHERED; k++) {
        binding->rank[k] = ranks[found->rank[k < count ? k : 0]];
        binding->weight[k] = (uint16_t)(square[k] * (1 << WEIGHT_BITS) / total);
        sum += binding->weight[k];
    }
    binding->weight[0] = (uint16_t)(binding->weight[0] + (1 << WEIGHT_BITS) - sum);
}

static void gather_few(search *s, const uint32_t *order, uint32_t count) {
    const candidates *from = &s->lists[NUM_SPLITS];
    nearest found = {.asked = s->asked, .rank = {0, 1, 2, 3, 4}};
    for (uint32_t i = 0; i < count; i++) {
        find_nearest(s, from, s->cells + 3 * (size_t)order[i], &found);
        bind(&found, from->ranks, s->bindings + order[i]);
    }
}

/* Parts of `count` points that were split `depth` times. */
static void gather_parts(search *s, const uint32_t *order, uint32_t count, int depth) {
    uint32_t size = part_sizes[depth];
    for (uint32_t at = 0; at < count; at += size) {
        uint32_t some = count - at < size ? count - at : size;
        box b = box_of(s->cells, order + at, some);
        select(s, &s->lists[depth], &b, &s->lists[depth + 1]);
        if (depth + 1 < NUM_SPLITS)
            gather_parts(s, order + at, some, depth + 1);
        else
            gather_few(s, order + at, some);
    }
}

static dfcgs_status take_search(dfcgs_arena *arena, const int32_t *control, uint32_t num_control, search *s) {
    for (int d = 0; d <= NUM_SPLITS; d++) DFCGS_TRY(take_candidates(arena, num_control, &s->lists[d]));
    s->near = DFCGS_TAKE(arena, float, num_control);
    s->far = DFCGS_TAKE(arena, float, num_control);
    s->close = DFCGS_TAKE(arena, uint32_t, (size_t)num_control + 1);
    if (!s->near || !s->far || !s->close) return DFCGS_MEMORY;
    candidates *all = &s->lists[0];
    all->count = num_control;
    for (uint32_t c = 0; c < num_control; c++) {
        all->ranks[c] = (uint16_t)c;
        for (int a = 0; a < 3; a++) all->axes[a][c] = (float)control[3 * (size_t)c + (size_t)a];
    }
    return DFCGS_OK;
}

dfcgs_status dfcgs_gather(dfcgs_arena *arena, const int32_t *cells, uint32_t count, const int32_t *control,
                          uint32_t num_control, dfcgs_binding *bindings) {
    size_t mark = arena->used;
    search s = {.cells = cells,
                .control = control,
                .bindings = bindings,
                .asked = num_control < MAX_ASKED ? (int)num_control : MAX_ASKED};
    uint32_t *order = DFCGS_TAKE(arena, uint32_t, count);
    if (!order) return DFCGS_MEMORY;
    DFCGS_TRY(take_search(arena, control, num_control, &s));
    DFCGS_TRY(dfcgs_near_order(arena, cells, count, order));
    gather_parts(&s, order, count, 0);
    arena->used = mark;
    return DFCGS_OK;
}
