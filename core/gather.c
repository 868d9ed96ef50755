/* 14.2: the nearest control points of each point. Points that are near each other share the control points
   that can be among the nearest of any of them: those no farther from the box of all of them than as many
   others are at most. */
#include "nearness.h"

enum { GROUP = 64, CROWD = 4096, MAX_ASKED = DFCGS_NUM_GATHERED + 1, WEIGHT_BITS = 12, RADIUS_BITS = 10 };

/* Control points by rank, rising; coordinates in binary64, in which squared distances, below 2**45, are
 * exact. */
typedef struct {
    uint32_t count;
    double *axes[3];
    uint16_t *ranks;
} candidates;

typedef struct {
    double low[3], high[3];
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
    some->ranks = DFCGS_TAKE(arena, uint16_t, most);
    for (int a = 0; a < 3; a++)
        if (!(some->axes[a] = DFCGS_TAKE(arena, double, most))) return DFCGS_MEMORY;
    return some->ranks ? DFCGS_OK : DFCGS_MEMORY;
}

static box box_of(const int32_t *cells, const uint32_t *order, uint32_t count) {
    box b;
    for (int a = 0; a < 3; a++) {
        b.low[a] = b.high[a] = cells[3 * (size_t)order[0] + a];
        for (uint32_t i = 1; i < count; i++) {
            double value = cells[3 * (size_t)order[i] + a];
            b.low[a] = value < b.low[a] ? value : b.low[a];
            b.high[a] = value > b.high[a] ? value : b.high[a];
        }
    }
    return b;
}

/* Squared distances of the candidates to the nearest and to the farthest place in a box. */
static void measure(const candidates *from, const box *b, double *near, double *far) {
    for (uint32_t c = 0; c < from->count; c++) {
        double inner = 0, outer = 0;
        for (int a = 0; a < 3; a++) {
            double below = b->low[a] - from->axes[a][c], above = from->axes[a][c] - b->high[a];
            double apart = below > above ? below : above, reach = below < above ? below : above;
            apart = apart > 0 ? apart : 0;
            inner += apart * apart;
            outer += reach * reach; /* the other side of the box lies -reach away */
        }
        near[c] = inner;
        far[c] = outer;
    }
}

/* Those of `from` that can be among the `asked` nearest of a point in the box. */
static void select(const candidates *from, const box *b, int asked, double *near, double *far,
                   candidates *to) {
    measure(from, b, near, far);
    nearest bound = nobody(asked);
    for (uint32_t c = 0; c < from->count; c++)
        if (far[c] < bound.distance[asked - 1]) see(&bound, far[c], c);
    to->count = 0;
    for (uint32_t c = 0; c < from->count; c++) {
        if (near[c] > bound.distance[asked - 1]) continue;
        for (int a = 0; a < 3; a++) to->axes[a][to->count] = from->axes[a][c];
        to->ranks[to->count++] = from->ranks[c];
    }
}

static nearest nearest_of(const candidates *from, const int32_t *cell, int asked, double *squared) {
    double x = cell[0], y = cell[1], z = cell[2];
    for (uint32_t c = 0; c < from->count; c++) {
        double dx = from->axes[0][c] - x, dy = from->axes[1][c] - y, dz = from->axes[2][c] - z;
        squared[c] = dx * dx + dy * dy + dz * dz;
    }
    nearest found = nobody(asked);
    for (uint32_t c = 0; c < from->count; c++)
        if (squared[c] < found.distance[asked - 1]) see(&found, squared[c], from->ranks[c]);
    return found;
}

/* Weights (1 - d / edge)**2, where the edge is the distance of the fifth nearest. */
static void bind(const nearest *found, dfcgs_binding *binding) {
    int count = found->asked < DFCGS_NUM_GATHERED ? found->asked : DFCGS_NUM_GATHERED;
    int64_t distance[MAX_ASKED] = {0}, square[DFCGS_NUM_GATHERED], total = 0, sum = 0;
    for (int k = 0; k < found->asked; k++) distance[k] = dfcgs_root((int64_t)found->distance[k]);
    int64_t last = distance[found->asked - 1], edge = dfcgs_max(found->asked > count ? last : 2 * last, 1);
    *binding = (dfcgs_binding){.choice = DFCGS_BLEND};
    for (int k = 0; k < count; k++) {
        int64_t reach = (1 << RADIUS_BITS) - dfcgs_quotient(distance[k] << RADIUS_BITS, edge);
        total += square[k] = reach * reach;
    }
    for (int k = 0; k < DFCGS_NUM_GATHERED; k++) {
        binding->rank[k] = (uint16_t)found->rank[k < count ? k : 0];
        if (k < count)
            binding->weight[k] = (uint16_t)dfcgs_quotient(square[k] << WEIGHT_BITS, dfcgs_max(total, 1));
        sum += binding->weight[k];
    }
    binding->weight[0] = (uint16_t)(binding->weight[0] + (1 << WEIGHT_BITS) - sum);
}

/* What the search of one call works on. */
typedef struct {
    const int32_t *cells;
    dfcgs_binding *bindings;
    int asked;
    double *near, *far;
    candidates all, crowd, group;
} search;

static void gather_group(search *s, const uint32_t *order, uint32_t count) {
    box b = box_of(s->cells, order, count);
    select(&s->crowd, &b, s->asked, s->near, s->far, &s->group);
    for (uint32_t i = 0; i < count; i++) {
        nearest found = nearest_of(&s->group, s->cells + 3 * (size_t)order[i], s->asked, s->near);
        bind(&found, s->bindings + order[i]);
    }
}

static void gather_crowd(search *s, const uint32_t *order, uint32_t count) {
    box b = box_of(s->cells, order, count);
    select(&s->all, &b, s->asked, s->near, s->far, &s->crowd);
    for (uint32_t at = 0; at < count; at += GROUP)
        gather_group(s, order + at, count - at < GROUP ? count - at : GROUP);
}

static dfcgs_status take_search(dfcgs_arena *arena, const int32_t *control, uint32_t num_control, search *s) {
    DFCGS_TRY(take_candidates(arena, num_control, &s->all));
    DFCGS_TRY(take_candidates(arena, num_control, &s->crowd));
    DFCGS_TRY(take_candidates(arena, num_control, &s->group));
    s->near = DFCGS_TAKE(arena, double, num_control);
    s->far = DFCGS_TAKE(arena, double, num_control);
    if (!s->near || !s->far) return DFCGS_MEMORY;
    s->all.count = num_control;
    for (uint32_t c = 0; c < num_control; c++) {
        s->all.ranks[c] = (uint16_t)c;
        for (int a = 0; a < 3; a++) s->all.axes[a][c] = control[3 * (size_t)c + a];
    }
    return DFCGS_OK;
}

dfcgs_status dfcgs_gather(dfcgs_arena *arena, const int32_t *cells, uint32_t count, const int32_t *control,
                          uint32_t num_control, dfcgs_binding *bindings) {
    size_t mark = arena->used;
    search s = {.cells = cells,
                .bindings = bindings,
                .asked = num_control < MAX_ASKED ? (int)num_control : MAX_ASKED};
    uint32_t *order = DFCGS_TAKE(arena, uint32_t, count);
    if (!order) return DFCGS_MEMORY;
    DFCGS_TRY(take_search(arena, control, num_control, &s));
    DFCGS_TRY(dfcgs_near_order(arena, cells, count, order));
    for (uint32_t at = 0; at < count; at += CROWD)
        gather_crowd(&s, order + at, count - at < CROWD ? count - at : CROWD);
    arena->used = mark;
    return DFCGS_OK;
}
