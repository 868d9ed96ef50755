#include "turns.h"

enum { AXIS_ONE = 1 << DFCGS_AXIS_BITS, TO_QUATERNION = 1 << (24 - DFCGS_AXIS_BITS), WEIGHT_BITS = 8 };

static int64_t dot(const int64_t a[3], const int64_t b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static int64_t twice(int64_t product) { return dfcgs_round_shift(product, 32); }

static void axes_of(const int64_t q[4], int64_t axes[3][3]) {
    int64_t w = q[0], x = q[1], y = q[2], z = q[3];
    axes[0][0] = AXIS_ONE - twice(y * y + z * z), axes[0][1] = twice(x * y + w * z),
    axes[0][2] = twice(x * z - w * y);
    axes[1][0] = twice(x * y - w * z), axes[1][1] = AXIS_ONE - twice(x * x + z * z),
    axes[1][2] = twice(y * z + w * x);
    axes[2][0] = twice(x * z + w * y), axes[2][1] = twice(y * z - w * x),
    axes[2][2] = AXIS_ONE - twice(x * x + y * y);
}

/* Neighbours of a row: their axes, weights, and which weighs most. */
typedef struct {
    const int32_t *axes[DFCGS_NEIGHBOURS];
    int64_t weight[DFCGS_NEIGHBOURS];
    int nearest;
} neighbours;

static neighbours neighbours_of(const int32_t *axes, uint32_t coarse, size_t stride, uint32_t i,
                                const int16_t *weights) {
    neighbours n = {.nearest = 0};
    for (int k = 0; k < DFCGS_NEIGHBOURS; k++) {
        int64_t place = dfcgs_clip((int64_t)i + k - 3, 0, (int64_t)coarse - 1);
        n.axes[k] = axes + (size_t)place * stride * DFCGS_AXES;
        n.weight[k] = weights ? weights[k] : 1 << (WEIGHT_BITS - 3);
        if (n.weight[k] > n.weight[n.nearest]) n.nearest = k;
    }
    return n;
}

static void axis_of(const neighbours *n, int k, int axis, int64_t line[3]) {
    for (int c = 0; c < 3; c++) line[c] = n->axes[k][3 * axis + c];
}

/* The sum of the neighbours' axes, all on the side of the nearest one's, times 256. */
static void line_of(const neighbours *n, int axis, int64_t total[3]) {
    int64_t nearest[3], one[3];
    axis_of(n, n->nearest, axis, nearest);
    total[0] = total[1] = total[2] = 0;
    for (int k = 0; k < DFCGS_NEIGHBOURS; k++) {
        axis_of(n, k, axis, one);
        int64_t weight = dot(one, nearest) < 0 ? -n->weight[k] : n->weight[k];
        for (int c = 0; c < 3; c++) total[c] += one[c] * weight;
    }
}

/* Where the pole is expected; how far neighbours' poles are from there. */
static int64_t expect_pole(const neighbours *n, int axis, int64_t pole[3]) {
    int64_t total[3], one[3], aligned = 0;
    line_of(n, axis, total);
    int64_t length = dfcgs_root(dot(total, total));
    for (int c = 0; c < 3; c++)
        pole[c] = length > 0 ? dfcgs_round_quotient(total[c] * AXIS_ONE, length) : c == axis ? AXIS_ONE : 0;
    if (pole[axis] < 0)
        for (int c = 0; c < 3; c++) pole[c] = -pole[c];
    for (int k = 0; k < DFCGS_NEIGHBOURS; k++) {
        axis_of(n, k, axis, one);
        aligned += dfcgs_abs(dot(one, pole)) * n->weight[k];
    }
    return dfcgs_max(((int64_t)1 << 38) - aligned, 0) >> 2;
}

/* The shortest turn from the pole's axis to `pole`. */
static void tilt_to(const int64_t pole[3], int needle, int64_t q[4]) {
    int64_t x = pole[0], y = pole[1], z = pole[2];
    q[0] = (AXIS_ONE + (needle ? x : z)) * TO_QUATERNION;
    q[1] = needle ? 0 : -y * TO_QUATERNION;
    q[2] = (needle ? -z : x) * TO_QUATERNION;
    q[3] = needle ? y * TO_QUATERNION : 0;
    dfcgs_normalise(q);
}

/* The turn about the pole that brings axis 1 of `tilted` to the neighbours' axis 1; how far they are from
 * there. */
static int64_t spin_to(const neighbours *n, const int64_t tilted[4], int needle, int64_t q[4]) {
    int64_t middle[3], axes[3][3];
    line_of(n, 1, middle);
    for (int c = 0; c < 3; c++) middle[c] >>= WEIGHT_BITS;
    axes_of(tilted, axes);
    int64_t along = dot(middle, axes[1]) >> DFCGS_AXIS_BITS;
    int64_t across = (needle ? dot(middle, axes[2]) : -dot(middle, axes[0])) >> DFCGS_AXIS_BITS;
    if (along < 0) along = -along, across = -across;
    int64_t length = dfcgs_root(along * along + across * across);
    q[0] = (length > 0 ? length + along : AXIS_ONE) * TO_QUATERNION;
    q[1] = needle ? across * TO_QUATERNION : 0;
    q[2] = 0;
    q[3] = needle ? 0 : across * TO_QUATERNION;
    dfcgs_normalise(q);
    return dfcgs_max(AXIS_ONE - length, 0) << 21;
}

void dfcgs_expect_turns(const int32_t *axes, const uint8_t *needles, uint32_t count, int level,
                        const int16_t *weights, int32_t *frames, int64_t *tilts, int64_t *spins) {
    uint32_t rows = dfcgs_level_rows(count, level), coarse = dfcgs_coarse_rows(count, level);
    size_t stride = (size_t)2 << level, row = stride / 2;
    for (uint32_t i = 0; i < rows; i++, row += stride, frames += 4) {
        neighbours n =
            neighbours_of(axes, coarse, stride, i, weights ? weights + (size_t)DFCGS_NEIGHBOURS * i : 0);
        int needle = needles[row];
        int64_t pole[3], tilted[4], spun[4];
        tilts[i] = expect_pole(&n, needle ? 0 : 2, pole);
        tilt_to(pole, needle, tilted);
        spins[i] = spin_to(&n, tilted, needle, spun);
        dfcgs_multiply(tilted, spun, tilted);
        dfcgs_normalise(tilted);
        for (int c = 0; c < 4; c++) frames[c] = (int32_t)tilted[c];
    }
}

/* q times 1, i, j or k */
static void flip(const int64_t q[4], int by, int32_t *rotation) {
    static const uint8_t place[4][4] = {{0, 1, 2, 3}, {1, 0, 3, 2}, {2, 3, 0, 1}, {3, 2, 1, 0}};
    static const int8_t sign[4][4] = {{1, 1, 1, 1}, {-1, 1, 1, -1}, {-1, -1, 1, 1}, {-1, 1, -1, 1}};
    for (int c = 0; c < 4; c++) rotation[c] = (int32_t)(sign[by][c] * q[place[by][c]]);
}

/* The quaternion of `frame`, tilted and spun. */
static void turned(const int32_t *frame, int needle, int64_t first, int64_t second, int64_t spin,
                   int64_t q[4]) {
    int64_t tilt_vector[3] = {needle ? 0 : first, needle ? first : second, needle ? second : 0};
    int64_t spin_vector[3] = {needle ? spin : 0, 0, needle ? 0 : spin}, by[4];
    for (int c = 0; c < 4; c++) q[c] = frame ? frame[c] : c == 0 ? DFCGS_ONE : 0;
    dfcgs_from_stereo(tilt_vector, by);
    dfcgs_multiply(q, by, q);
    dfcgs_from_stereo(spin_vector, by);
    dfcgs_multiply(q, by, q);
    dfcgs_normalise(q);
}

void dfcgs_apply_turns(uint32_t first, uint32_t stride, uint32_t rows, const uint8_t *needles,
                       const int32_t *frames, const int32_t *tilts, const int32_t *spins,
                       const uint8_t *flips, int32_t *rotations, int32_t *axes) {
    size_t row = first;
    for (uint32_t i = 0; i < rows; i++, row += stride) {
        int64_t q[4], found[3][3];
        turned(frames ? frames + 4 * (size_t)i : 0, needles[row], tilts[i], tilts[(size_t)rows + i], spins[i],
               q);
        axes_of(q, found);
        for (int c = 0; c < DFCGS_AXES; c++)
            axes[row * DFCGS_AXES + (size_t)c] = (int32_t)found[c / 3][c % 3];
        flip(q, flips ? flips[i] : 0, rotations + 4 * row);
    }
}
