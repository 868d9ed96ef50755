#include "prior.h"

enum {
    PRESENT = 64,
    SMALL = 16,
    EFFORT_SHIFT = 4,
    BLOCK_LOG2 = 6,
    MEMORY_BITS = 4,
    DECAY_LOG2 = 2,
    MAX_RUNNING = 1 << 20
};
enum { NUM_FRACTIONS = 3, NUM_LOW_CLASSES = 18, NUM_KINDS = 4, FRACTION_BITS = 16, MEAN_BITS = 8 };
#define EIGHTH ((int64_t)1 << (FRACTION_BITS - 3))

static int64_t size_of(const int32_t *symbols, int columns) {
    int64_t size = 0;
    for (int c = 0; c < columns; c++) size += dfcgs_abs(symbols[c]);
    return size;
}

void dfcgs_log_sizes(const int32_t *symbols, uint32_t count, int columns, uint8_t *sizes) {
    for (uint32_t i = 0; i < count; i++, symbols += columns)
        sizes[i] = dfcgs_log((uint64_t)size_of(symbols, columns));
}

void dfcgs_remember(const int32_t *symbols, uint32_t count, int columns, int32_t *running, int64_t *memory) {
    for (uint32_t i = 0; i < count; i++, symbols += columns, memory += columns) {
        int32_t size = (int32_t)dfcgs_min(size_of(symbols, columns), MAX_RUNNING);
        running[i] += (size << (MEMORY_BITS - DECAY_LOG2)) - (running[i] >> DECAY_LOG2);
        for (int c = 0; c < columns; c++) {
            int64_t change = memory[c] - (int64_t)symbols[c] * (1 << MEMORY_BITS);
            memory[c] = change - (change >> DECAY_LOG2);
        }
    }
}

static uint8_t limited(int64_t value) { return (uint8_t)dfcgs_min(value, DFCGS_INPUT_LIMIT); }

/* The efforts of a point, without their last bits: that of its choice, the least, the largest less the least.
 */
static void effort_inputs(const dfcgs_binding *binding, uint8_t *chosen, uint8_t *least, uint8_t *range) {
    int low = binding->effort[0], high = low;
    for (int j = 1; j < DFCGS_NUM_CANDIDATES; j++) {
        low = binding->effort[j] < low ? binding->effort[j] : low;
        high = binding->effort[j] > high ? binding->effort[j] : high;
    }
    *chosen = limited(binding->effort[binding->choice] >> EFFORT_SHIFT);
    *least = limited(low >> EFFORT_SHIFT);
    *range = limited((high >> EFFORT_SHIFT) - (low >> EFFORT_SHIFT));
}

void dfcgs_gaussian_inputs(const dfcgs_binding *bindings, const uint8_t *follows, uint32_t count,
                           uint8_t *inputs) {
    for (uint32_t i = 0; i < count; i++, inputs += DFCGS_NUM_GAUSSIAN_INPUTS) {
        inputs[0] = inputs[1] = inputs[2] = 0;
        if (bindings) effort_inputs(bindings + i, inputs, inputs + 1, inputs + 2);
        inputs[3] = !bindings || bindings[i].choice == DFCGS_BLEND ? PRESENT : 0;
        inputs[4] = follows && follows[i] ? PRESENT : 0;
    }
}

static uint8_t memory_of(const dfcgs_known *known, uint32_t row) {
    const int64_t *memory = known->memory + (size_t)row * (size_t)known->columns;
    int64_t size = 0;
    for (int c = 0; c < known->columns; c++) size += dfcgs_abs(memory[c]);
    return dfcgs_log((uint64_t)size);
}

static int present(const uint8_t *values, uint32_t at, int factor) {
    return values ? factor * values[at] : 0;
}

static void inputs_of_row(const dfcgs_known *known, uint32_t row, int sort, uint8_t *x) {
    uint32_t block = row >> BLOCK_LOG2;
    memcpy(x, known->gaussians + (size_t)row * DFCGS_NUM_GAUSSIAN_INPUTS, DFCGS_NUM_GAUSSIAN_INPUTS);
    x[5] = limited(present(known->coarseness, row, 2));
    x[6] = (uint8_t)present(known->before, row, 1);
    x[7] = known->running ? dfcgs_log((uint64_t)known->running[row]) : 0;
    x[8] = known->memory ? memory_of(known, row) : 0;
    x[9] = limited(present(known->density_before, block, SMALL));
    x[10] = limited(present(known->density, block, SMALL));
    x[11] = limited(present(known->magnitude, block, 4));
    for (int a = 0; a < DFCGS_NUM_EARLIER; a++) x[12 + a] = (uint8_t)present(known->earlier[a], row, 1);
    for (int s = 0; s < DFCGS_NUM_SORTS; s++) x[14 + s] = s == sort ? PRESENT : 0;
}

void dfcgs_common_inputs(const dfcgs_known *known, const uint32_t *rows, uint32_t count, uint8_t *inputs) {
    int sort = known->attribute < DFCGS_SH_1 ? known->attribute : DFCGS_SH_1;
    for (uint32_t i = 0; i < count; i++)
        inputs_of_row(known, rows[i], sort, inputs + (size_t)DFCGS_NUM_COMMON * i);
}

static uint8_t log_of(int32_t symbol) { return dfcgs_log((uint64_t)dfcgs_abs(symbol)); }

void dfcgs_other_inputs(const int32_t *before, const int32_t *symbols, uint32_t count, int columns,
                        int column, int last_input, uint8_t *others) {
    for (uint32_t i = 0; i < count; i++, before += columns, symbols += columns, others += DFCGS_NUM_OTHERS) {
        memset(others, 0, DFCGS_NUM_OTHERS);
        others[3] = log_of(before[column]);
        if (column > 0) others[4] = log_of(symbols[column - 1]);
        if (column > 1) others[5] = log_of(symbols[column - 2]);
        others[6] = dfcgs_log((uint64_t)size_of(symbols, column));
        others[9] = (uint8_t)last_input;
    }
}

void dfcgs_add_feature(const int32_t *feature, uint32_t count, uint32_t stride, int weight, int64_t *own) {
    if (weight == 0) return;
    for (uint32_t i = 0; i < count; i++) own[i] += (int64_t)feature[(size_t)i * stride] * weight;
}

void dfcgs_add_wide_feature(const int64_t *feature, uint32_t count, uint32_t stride, int weight,
                            int64_t *own) {
    if (weight == 0) return;
    for (uint32_t i = 0; i < count; i++) own[i] += feature[(size_t)i * stride] * weight;
}

static int cell_of(int class, int kind, int fraction) {
    return class < NUM_LOW_CLASSES ? (kind * NUM_FRACTIONS + fraction) * NUM_LOW_CLASSES + class
                                   : NUM_KINDS * NUM_FRACTIONS * NUM_LOW_CLASSES + class - NUM_LOW_CLASSES;
}

/* What a pass finds of one row; `low` and `high` are u, those of `others` filled in. */
typedef struct {
    int64_t prediction;
    uint64_t low, high;
    int kind, quarters, flipped;
} expectation;

static expectation expect(const dfcgs_component *component, size_t row, int64_t expected) {
    expectation e = {.prediction = dfcgs_round_shift(expected, FRACTION_BITS)};
    int64_t fraction = expected - e.prediction * (1 << FRACTION_BITS), size = dfcgs_abs(fraction);
    memcpy(&e.low, component->others + row * DFCGS_NUM_OTHERS, sizeof e.low);
    e.high = (uint64_t)component->others[row * DFCGS_NUM_OTHERS + 9] << 8;
    e.kind = e.prediction == 0 && component->kinds ? component->kinds[row] : 0;
    e.quarters = (size >= EIGHTH) + (size >= 3 * EIGHTH);
    e.flipped = fraction < 0 && e.quarters > 0;
    e.low |= (uint64_t)dfcgs_log((uint64_t)(dfcgs_abs(expected) >> (FRACTION_BITS - MEAN_BITS))) << 56;
    e.high |= e.kind > 0 ? PRESENT : 0;
    return e;
}

void dfcgs_pass(const dfcgs_component *component, uint32_t first, uint32_t stride, uint32_t rows,
                const int64_t *mean, const int64_t *deviation, int64_t *predictions, uint8_t *contexts,
                uint8_t *flipped) {
    size_t width = (size_t)dfcgs_prepared_width(component->network), row = first;
    for (uint32_t i = 0; i < rows; i++, row += stride) {
        int64_t neighbours = mean ? mean[i] * component->mean_weight : 0;
        expectation e = expect(component, row, component->own[row] + neighbours);
        if (mean)
            e.low |= dfcgs_log((uint64_t)deviation[i]) | (uint64_t)dfcgs_log((uint64_t)dfcgs_abs(mean[i]))
                                                             << 8;
        else
            e.low |= (uint64_t)PRESENT << 16;
        int class =
            dfcgs_class_of_words(component->network, component->prepared + row * width, e.low, e.high);
        predictions[i] = e.prediction;
        flipped[i] = (uint8_t)e.flipped;
        contexts[i] = (uint8_t)cell_of(class, e.kind, e.quarters);
    }
}

void dfcgs_flag_classes(const dfcgs_network *network, const int32_t *prepared, const uint32_t *rows,
                        uint32_t count, const int64_t *mean, uint8_t *classes) {
    size_t width = (size_t)dfcgs_prepared_width(network);
    for (uint32_t i = 0; i < count; i++) {
        uint64_t u = mean ? (uint64_t)mean[i] >> (MEAN_BITS + 1) & 255 : (uint64_t)PRESENT << 8;
        classes[i] = dfcgs_class_of_words(network, prepared + rows[i] * width, u, 0);
    }
}
