#include "reconstruct.h"

static int64_t coarser(int64_t change, const uint8_t *coarseness, uint32_t i) {
    return coarseness ? dfcgs_round_shift(change * dfcgs_multipliers[coarseness[i]], DFCGS_MULTIPLIER_BITS)
                      : change;
}

static int beyond(int64_t value, int64_t limit) { return value < -limit || value > limit; }

static uint32_t largest_of(const int32_t *values, size_t count) {
    uint32_t largest = 0;
    for (size_t i = 0; i < count; i++) {
        uint32_t magnitude = values[i] < 0 ? -(uint32_t)values[i] : (uint32_t)values[i];
        largest = magnitude > largest ? magnitude : largest;
    }
    return largest;
}

/* The larger of `largest` and of the magnitudes of values that were changed by symbols times `unit`, in
 * 2**-shift. */
static uint32_t change(int32_t *restrict values, const int32_t *restrict symbols, size_t count, int32_t unit,
                       int shift, uint32_t largest) {
    int32_t half = (1 << shift) >> 1;
    for (size_t i = 0; i < count; i++) {
        int32_t value = values[i] + ((symbols[i] * unit + half) >> shift);
        uint32_t magnitude = value < 0 ? -(uint32_t)value : (uint32_t)value;
        values[i] = value;
        largest = magnitude > largest ? magnitude : largest;
    }
    return largest;
}

/* Where no change leaves 30 bits, so that none of a value of the state leaves 32. */
static dfcgs_status reconstruct_narrow(int32_t *plane, const int32_t *symbols, uint32_t count, int columns,
                                       int step, const uint8_t *coarseness) {
    size_t width = (size_t)columns;
    uint32_t largest = 0;
    if (!coarseness) largest = change(plane, symbols, count * width, step, 0, 0);
    for (uint32_t i = 0; coarseness && i < count; i++)
        largest = change(plane + i * width, symbols + i * width, width,
                         step * dfcgs_multipliers[coarseness[i]], DFCGS_MULTIPLIER_BITS, largest);
    return largest > DFCGS_STATE_LIMIT ? DFCGS_CORRUPT : DFCGS_OK;
}

static dfcgs_status reconstruct_wide(int32_t *plane, const int32_t *symbols, uint32_t count, int columns,
                                     int step, const uint8_t *coarseness) {
    for (uint32_t i = 0; i < count; i++, plane += columns, symbols += columns)
        for (int c = 0; c < columns; c++) {
            int64_t value = plane[c] + coarser((int64_t)symbols[c] * step, coarseness, i);
            if (beyond(value, DFCGS_STATE_LIMIT)) return DFCGS_CORRUPT;
            plane[c] = (int32_t)value;
        }
    return DFCGS_OK;
}

dfcgs_status dfcgs_reconstruct(int32_t *plane, const int32_t *symbols, uint32_t count, int columns, int step,
                               const uint8_t *coarseness) {
    int64_t largest = largest_of(symbols, count * (size_t)columns),
            limit = 2 * (int64_t)DFCGS_STATE_LIMIT / step;
    if (largest == 0) return DFCGS_OK;
    if (largest > limit) return DFCGS_CORRUPT;
    if (largest * step < 1 << (30 - DFCGS_MULTIPLIER_BITS - 4))
        return reconstruct_narrow(plane, symbols, count, columns, step, coarseness);
    return reconstruct_wide(plane, symbols, count, columns, step, coarseness);
}

static void turn_row(int32_t *rotation, const int64_t vector[3]) {
    int64_t q[4] = {rotation[0], rotation[1], rotation[2], rotation[3]}, turn[4];
    dfcgs_from_stereo(vector, turn);
    dfcgs_multiply(q, turn, q);
    dfcgs_normalise(q);
    for (int c = 0; c < 4; c++) rotation[c] = (int32_t)q[c];
}

dfcgs_status dfcgs_turn(int32_t *rotations, const int32_t *symbols, uint32_t count, int step,
                        const uint8_t *coarseness) {
    int64_t limit = 2 * (int64_t)DFCGS_STATE_LIMIT / step;
    for (uint32_t i = 0; i < count; i++, rotations += 4, symbols += 3) {
        if (!(symbols[0] | symbols[1] | symbols[2])) continue;
        int64_t vector[3];
        for (int c = 0; c < 3; c++) {
            if (beyond(symbols[c], limit)) return DFCGS_CORRUPT;
            vector[c] = coarser((int64_t)symbols[c] * step, coarseness, i);
        }
        turn_row(rotations, vector);
    }
    return DFCGS_OK;
}

/* a[t] = a[t - 1] xor a[t - 3] xor p[t - 2] in each of the chains, whose symbols lie `chains` apart */
void dfcgs_second_quantisers(const int32_t *symbols, uint32_t count, uint8_t *second) {
    uint32_t chains = (count + DFCGS_CHAIN_LENGTH - 1) / DFCGS_CHAIN_LENGTH, i = 0;
    for (; i < 2 * chains && i < count; i++) second[i] = 0;
    for (; i < 3 * chains && i < count; i++) second[i] = second[i - chains] ^ (symbols[i - 2 * chains] & 1);
    for (; i < count; i++)
        second[i] = second[i - chains] ^ second[i - 3 * chains] ^ (symbols[i - 2 * chains] & 1);
}

dfcgs_status dfcgs_intra_positions(const int32_t *index, uint32_t count, const uint8_t *octaves, int step,
                                   int32_t *positions) {
    int64_t limit = 2 * (int64_t)DFCGS_STATE_LIMIT / step;
    for (uint32_t i = 0; i < count; i++) {
        int64_t width = (int64_t)1 << octaves[i];
        for (int axis = 0; axis < 3; axis++, index++, positions++) {
            if (beyond(*index, limit)) return DFCGS_CORRUPT;
            int64_t value = *index * width * step + (((width - 1) * step) >> 1);
            if (beyond(value, DFCGS_STATE_LIMIT)) return DFCGS_CORRUPT;
            *positions = (int32_t)value;
        }
    }
    return DFCGS_OK;
}

void dfcgs_anchors(const int32_t *positions, uint32_t count, int step, int32_t *anchors) {
    for (size_t i = 0; i < 3 * (size_t)count; i++)
        anchors[i] = (int32_t)dfcgs_round_quotient(positions[i], step);
}
