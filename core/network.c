#include "network.h"

#if defined(__wasm_simd128__)
#include <wasm_simd128.h>

/* Adds to 16 sums the products of `pairs` pairs of inputs and their weights. */
static void add_products(const int16_t *weights, const int16_t *inputs, int pairs, int32_t *sums) {
    v128_t a = wasm_v128_load(sums), b = wasm_v128_load(sums + 4), c = wasm_v128_load(sums + 8),
           d = wasm_v128_load(sums + 12);
    for (int p = 0; p < pairs; p++, weights += DFCGS_GROUP * DFCGS_PAIR) {
        v128_t x = wasm_v128_load32_splat(inputs + DFCGS_PAIR * p);
        a = wasm_i32x4_add(a, wasm_i32x4_dot_i16x8(wasm_v128_load(weights), x));
        b = wasm_i32x4_add(b, wasm_i32x4_dot_i16x8(wasm_v128_load(weights + 8), x));
        c = wasm_i32x4_add(c, wasm_i32x4_dot_i16x8(wasm_v128_load(weights + 16), x));
        d = wasm_i32x4_add(d, wasm_i32x4_dot_i16x8(wasm_v128_load(weights + 24), x));
    }
    wasm_v128_store(sums, a);
    wasm_v128_store(sums + 4, b);
    wasm_v128_store(sums + 8, c);
    wasm_v128_store(sums + 12, d);
}

/* clip(sum >> shift, 0, limit) of 16 sums */
static void activate(const int32_t *sums, int shift, int limit, int16_t *values) {
    v128_t most = wasm_i16x8_splat((int16_t)limit), zero = wasm_i16x8_const_splat(0);
    for (int half = 0; half < DFCGS_GROUP; half += 8) {
        v128_t a = wasm_i32x4_shr(wasm_v128_load(sums + half), (uint32_t)shift);
        v128_t b = wasm_i32x4_shr(wasm_v128_load(sums + half + 4), (uint32_t)shift);
        v128_t both = wasm_i16x8_narrow_i32x4(a, b); /* saturates, and the limit is below that */
        wasm_v128_store(values + half, wasm_i16x8_max(wasm_i16x8_min(both, most), zero));
    }
}
#else
static void add_products(const int16_t *weights, const int16_t *inputs, int pairs, int32_t *sums) {
    for (int p = 0; p < pairs; p++, weights += DFCGS_GROUP * DFCGS_PAIR)
        for (int o = 0; o < DFCGS_GROUP; o++)
            sums[o] += weights[2 * o] * inputs[2 * p] + weights[2 * o + 1] * inputs[2 * p + 1];
}

static void activate(const int32_t *sums, int shift, int limit, int16_t *values) {
    for (int o = 0; o < DFCGS_GROUP; o++) values[o] = (int16_t)dfcgs_clip(sums[o] >> shift, 0, limit);
}
#endif

static int words_of_layer(const int32_t *words, uint32_t count, uint32_t *needed) {
    if (count < 4 || words[0] < 1 || words[0] > DFCGS_MAX_WIDTH || words[1] < 1 || words[1] > DFCGS_MAX_WIDTH)
        return 0;
    *needed = 4 + (uint32_t)words[0] + (uint32_t)words[0] * (uint32_t)words[1];
    return *needed <= count;
}

/* Whether shift, limit and weights of the layer that begins at `words` are those of a model. */
static int keeps_bounds(const int32_t *words, int input_limit) {
    int outputs = words[0], inputs = words[1];
    const int32_t *bias = words + 4, *weights = bias + outputs;
    if (words[2] < 0 || words[2] > 23 || words[3] < 1 || words[3] > DFCGS_ACTIVATION_LIMIT) return 0;
    for (int o = 0; o < outputs; o++) {
        int64_t sum = 0;
        for (int i = 0; i < inputs; i++, weights++) {
            if (*weights < INT16_MIN || *weights > INT16_MAX) return 0;
            sum += dfcgs_abs(*weights);
        }
        if (sum * input_limit + dfcgs_abs(bias[o]) >= 1 << 24) return 0;
    }
    return 1;
}

/* The part of a layer that the inputs from `first` on make, `width` of them; its biases only where `first` is
 * 0. */
static dfcgs_status take_layer(dfcgs_arena *arena, const int32_t *words, int first, int width,
                               dfcgs_layer *layer) {
    int outputs = words[0], inputs = words[1], group = outputs == 1 ? 1 : DFCGS_GROUP;
    *layer = (dfcgs_layer){
        (outputs + group - 1) / group, (width + DFCGS_PAIR - 1) / DFCGS_PAIR, words[2], words[3], 0, 0};
    int16_t *weights =
        DFCGS_ZEROS(arena, int16_t, (size_t)(layer->groups * layer->pairs * group * DFCGS_PAIR));
    int32_t *bias = DFCGS_ZEROS(arena, int32_t, (size_t)(layer->groups * group));
    if (!weights || !bias) return DFCGS_MEMORY;
    for (int o = 0; o < outputs; o++) {
        if (first == 0) bias[o] = words[4 + o];
        const int32_t *row = words + 4 + outputs + o * inputs + first;
        for (int i = 0; i < width; i++) {
            int pair = (o / group * layer->pairs + i / DFCGS_PAIR) * group + o % group;
            weights[pair * DFCGS_PAIR + i % DFCGS_PAIR] = (int16_t)row[i];
        }
    }
    layer->weights = weights;
    layer->bias = bias;
    return DFCGS_OK;
}

/* Whether a layer, one of `layers`, has as many outputs as its place wants. */
static int fits(const int32_t *words, int width, int is_last, int num_classes) {
    return words[1] == width && (is_last ? words[0] == 1 && words[3] == num_classes - 1 : words[0] > 1);
}

dfcgs_status dfcgs_read_network(dfcgs_arena *arena, const int32_t *words, uint32_t count, int num_common,
                                int num_others, int num_classes, dfcgs_network *network, uint32_t *used) {
    if (count < 1 || words[0] < 2 || words[0] > DFCGS_MAX_LAYERS) return DFCGS_MODEL;
    *network = (dfcgs_network){.num_layers = words[0], .num_common = num_common, .num_others = num_others};
    int width = num_common + num_others, limit = DFCGS_INPUT_LIMIT;
    uint32_t at = 1, needed;
    for (int l = 0; l < network->num_layers; l++, at += needed) {
        const int32_t *layer = words + at;
        if (!words_of_layer(layer, count - at, &needed) || !keeps_bounds(layer, limit) ||
            !fits(layer, width, l == network->num_layers - 1, num_classes))
            return DFCGS_MODEL;
        if (l == 0) DFCGS_TRY(take_layer(arena, layer, 0, num_common, &network->common));
        int first = l == 0 ? num_common : 0;
        DFCGS_TRY(take_layer(arena, layer, first, width - first, &network->layers[l]));
        width = layer[0];
        limit = layer[3];
    }
    *used = at;
    return DFCGS_OK;
}

static void widen(const uint8_t *values, int count, int pairs, int16_t *wide) {
    wide[DFCGS_PAIR * pairs - 1] = 0;
    for (int i = 0; i < count; i++) wide[i] = values[i];
}

void dfcgs_prepare(const dfcgs_network *network, const uint8_t *common, uint32_t rows, int32_t *prepared) {
    const dfcgs_layer *layer = &network->common;
    int16_t inputs[DFCGS_MAX_WIDTH];
    size_t group_weights = (size_t)layer->pairs * DFCGS_GROUP * DFCGS_PAIR;
    for (uint32_t i = 0; i < rows; i++, common += network->num_common) {
        widen(common, network->num_common, layer->pairs, inputs);
        for (int g = 0; g < layer->groups; g++, prepared += DFCGS_GROUP) {
            memcpy(prepared, layer->bias + DFCGS_GROUP * g, DFCGS_GROUP * sizeof *prepared);
            add_products(layer->weights + (size_t)g * group_weights, inputs, layer->pairs, prepared);
        }
    }
}

/* The outputs of a layer that is not the last; `start`: what its sums begin with. */
static void layer_outputs(const dfcgs_layer *layer, const int32_t *start, const int16_t *inputs,
                          int16_t *outputs) {
    size_t group_weights = (size_t)layer->pairs * DFCGS_GROUP * DFCGS_PAIR;
    for (int g = 0; g < layer->groups; g++) {
        int32_t sums[DFCGS_GROUP];
        memcpy(sums, start + DFCGS_GROUP * g, sizeof sums);
        add_products(layer->weights + (size_t)g * group_weights, inputs, layer->pairs, sums);
        activate(sums, layer->shift, layer->limit, outputs + DFCGS_GROUP * g);
    }
}

uint8_t dfcgs_class(const dfcgs_network *network, const int32_t *prepared, const uint8_t *others) {
    int16_t values[2][DFCGS_MAX_WIDTH];
    int now = 0, last = network->num_layers - 1;
    widen(others, network->num_others, network->layers[0].pairs, values[1]);
    layer_outputs(&network->layers[0], prepared, values[1], values[0]);
    for (int l = 1; l < last; l++, now = 1 - now)
        layer_outputs(&network->layers[l], network->layers[l].bias, values[now], values[1 - now]);
    const dfcgs_layer *end = &network->layers[last];
    int32_t sum = end->bias[0];
    for (int i = 0; i < DFCGS_PAIR * end->pairs; i++) sum += end->weights[i] * values[now][i];
    return (uint8_t)dfcgs_clip(sum >> end->shift, 0, end->limit);
}

void dfcgs_classes(const dfcgs_network *network, const int32_t *prepared, const uint8_t *others,
                   uint32_t rows, uint8_t *classes) {
    for (uint32_t i = 0; i < rows;
         i++, prepared += dfcgs_prepared_width(network), others += network->num_others)
        classes[i] = dfcgs_class(network, prepared, others);
}
