#include "network.h"

#if defined(__wasm_simd128__)
#include <wasm_simd128.h>

/* Sixteen sums, and sixteen activations. */
typedef struct {
    v128_t part[4];
} sums;
typedef struct {
    v128_t half[2];
} values;

static sums load_sums(const int32_t *from) {
    return (sums){{wasm_v128_load(from), wasm_v128_load(from + 4), wasm_v128_load(from + 8),
                   wasm_v128_load(from + 12)}};
}

static void store_sums(const sums *s, int32_t *to) {
    for (int q = 0; q < 4; q++) wasm_v128_store(to + 4 * q, s->part[q]);
}

/* The products of a pair of inputs, which stands in all four lanes, and its weights. */
static void add_pair(const int16_t *weights, v128_t pair, sums *s) {
    for (int q = 0; q < 4; q++)
        s->part[q] = wasm_i32x4_add(s->part[q], wasm_i32x4_dot_i16x8(wasm_v128_load(weights + 8 * q), pair));
}

/* Those of the four pairs of eight inputs. */
static void add_four_pairs(const int16_t *weights, v128_t inputs, sums *s) {
    const int width = DFCGS_GROUP * DFCGS_PAIR;
    add_pair(weights, wasm_i32x4_shuffle(inputs, inputs, 0, 0, 0, 0), s);
    add_pair(weights + width, wasm_i32x4_shuffle(inputs, inputs, 1, 1, 1, 1), s);
    add_pair(weights + 2 * width, wasm_i32x4_shuffle(inputs, inputs, 2, 2, 2, 2), s);
    add_pair(weights + 3 * width, wasm_i32x4_shuffle(inputs, inputs, 3, 3, 3, 3), s);
}

/* clip(sum >> shift, 0, limit): narrowing saturates, and the limit is below that */
static v128_t activate_half(v128_t low, v128_t high, int shift, int limit) {
    v128_t both =
        wasm_i16x8_narrow_i32x4(wasm_i32x4_shr(low, (uint32_t)shift), wasm_i32x4_shr(high, (uint32_t)shift));
    return wasm_i16x8_max(wasm_i16x8_min(both, wasm_i16x8_splat((int16_t)limit)), wasm_i16x8_const_splat(0));
}

static values activate(const sums *s, const dfcgs_layer *layer) {
    return (values){{activate_half(s->part[0], s->part[1], layer->shift, layer->limit),
                     activate_half(s->part[2], s->part[3], layer->shift, layer->limit)}};
}

/* The sum of a last layer. */
static int32_t last_sum(const dfcgs_layer *layer, const values *x) {
    v128_t sum = wasm_i32x4_add(wasm_i32x4_dot_i16x8(wasm_v128_load(layer->weights), x->half[0]),
                                wasm_i32x4_dot_i16x8(wasm_v128_load(layer->weights + 8), x->half[1]));
    sum = wasm_i32x4_add(sum, wasm_i32x4_shuffle(sum, sum, 2, 3, 0, 1));
    return wasm_i32x4_extract_lane(sum, 0) + wasm_i32x4_extract_lane(sum, 1) + layer->bias[0];
}

/* The class where no layer has more than sixteen outputs, and there are no more than sixteen others. */
static uint8_t narrow_class(const dfcgs_network *network, const int32_t *prepared, uint64_t low,
                            uint64_t high) {
    const dfcgs_layer *layer = network->layers, *last = layer + network->num_layers - 1;
    v128_t others = wasm_u64x2_make(low, high);
    sums s = load_sums(prepared);
    add_four_pairs(layer->weights, wasm_u16x8_extend_low_u8x16(others), &s);
    const int16_t *more = layer->weights + 4 * DFCGS_GROUP * DFCGS_PAIR;
    v128_t rest = wasm_u16x8_extend_high_u8x16(others);
    if (network->num_others > 8 + DFCGS_PAIR) add_four_pairs(more, rest, &s);
    else if (network->num_others > 8) add_pair(more, wasm_i32x4_shuffle(rest, rest, 0, 0, 0, 0), &s);
    values x = activate(&s, layer);
    while (++layer < last) {
        s = load_sums(layer->bias);
        add_four_pairs(layer->weights, x.half[0], &s);
        add_four_pairs(layer->weights + 4 * DFCGS_GROUP * DFCGS_PAIR, x.half[1], &s);
        x = activate(&s, layer);
    }
    return (uint8_t)dfcgs_clip(last_sum(last, &x) >> last->shift, 0, last->limit);
}

static void add_products(const int16_t *weights, const int16_t *inputs, int pairs, int32_t *totals) {
    sums s = load_sums(totals);
    for (int p = 0; p < pairs; p++)
        add_pair(weights + DFCGS_GROUP * DFCGS_PAIR * p, wasm_v128_load32_splat(inputs + DFCGS_PAIR * p), &s);
    store_sums(&s, totals);
}

/* Bytes as sixteen bits each, whole vectors of them: what is stored so can be read back by pairs without
 * waiting. */
static void widen(const uint8_t *bytes, int count, int16_t *wide) {
    uint8_t padded[DFCGS_MAX_WIDTH] = {0};
    memcpy(padded, bytes, (size_t)count);
    for (int i = 0; i < count; i += 8) wasm_v128_store(wide + i, wasm_u16x8_load8x8(padded + i));
}
#else
/* Adds to 16 sums the products of `pairs` pairs of inputs and their weights. */
static void add_products(const int16_t *weights, const int16_t *inputs, int pairs, int32_t *totals) {
    for (int p = 0; p < pairs; p++, weights += DFCGS_GROUP * DFCGS_PAIR)
        for (int o = 0; o < DFCGS_GROUP; o++)
            totals[o] += weights[2 * o] * inputs[2 * p] + weights[2 * o + 1] * inputs[2 * p + 1];
}

static void widen(const uint8_t *bytes, int count, int16_t *wide) {
    for (int i = 0; i < DFCGS_MAX_WIDTH; i++) wide[i] = i < count ? bytes[i] : 0;
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
    int pairs = (width + DFCGS_GROUP - 1) / DFCGS_GROUP * (DFCGS_GROUP / DFCGS_PAIR);
    *layer = (dfcgs_layer){(outputs + group - 1) / group, pairs, words[2], words[3], 0, 0};
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
    network->is_narrow = num_others <= DFCGS_GROUP;
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
        network->is_narrow &= width <= DFCGS_GROUP;
    }
    *used = at;
    return DFCGS_OK;
}

void dfcgs_prepare(const dfcgs_network *network, const uint8_t *common, uint32_t rows, int32_t *prepared) {
    const dfcgs_layer *layer = &network->common;
    int16_t inputs[DFCGS_MAX_WIDTH];
    size_t group_weights = (size_t)layer->pairs * DFCGS_GROUP * DFCGS_PAIR;
    for (uint32_t i = 0; i < rows; i++, common += network->num_common) {
        widen(common, network->num_common, inputs);
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
        int32_t totals[DFCGS_GROUP];
        memcpy(totals, start + DFCGS_GROUP * g, sizeof totals);
        add_products(layer->weights + (size_t)g * group_weights, inputs, layer->pairs, totals);
        for (int o = 0; o < DFCGS_GROUP; o++)
            outputs[DFCGS_GROUP * g + o] = (int16_t)dfcgs_clip(totals[o] >> layer->shift, 0, layer->limit);
    }
}

/* The class where layers may be of any width. */
static uint8_t wide_class(const dfcgs_network *network, const int32_t *prepared, const uint8_t *others) {
    int16_t activations[2][DFCGS_MAX_WIDTH];
    int now = 0, last = network->num_layers - 1;
    widen(others, network->num_others, activations[1]);
    layer_outputs(&network->layers[0], prepared, activations[1], activations[0]);
    for (int l = 1; l < last; l++, now = 1 - now)
        layer_outputs(&network->layers[l], network->layers[l].bias, activations[now], activations[1 - now]);
    const dfcgs_layer *end = &network->layers[last];
    int32_t sum = end->bias[0];
    for (int i = 0; i < DFCGS_PAIR * end->pairs; i++) sum += end->weights[i] * activations[now][i];
    return (uint8_t)dfcgs_clip(sum >> end->shift, 0, end->limit);
}

uint8_t dfcgs_class_of_words(const dfcgs_network *network, const int32_t *prepared, uint64_t low,
                             uint64_t high) {
#if defined(__wasm_simd128__)
    if (network->is_narrow) return narrow_class(network, prepared, low, high);
#endif
    uint64_t others[DFCGS_MAX_WIDTH / 8] = {low, high};
    return wide_class(network, prepared, (const uint8_t *)others);
}

uint8_t dfcgs_class(const dfcgs_network *network, const int32_t *prepared, const uint8_t *others) {
    uint64_t words[2] = {0, 0};
    if (!network->is_narrow) return wide_class(network, prepared, others);
    memcpy(words, others, (size_t)network->num_others);
    return dfcgs_class_of_words(network, prepared, words[0], words[1]);
}

void dfcgs_classes(const dfcgs_network *network, const int32_t *prepared, const uint8_t *others,
                   uint32_t rows, uint8_t *classes) {
    for (uint32_t i = 0; i < rows;
         i++, prepared += dfcgs_prepared_width(network), others += network->num_others)
        classes[i] = dfcgs_class(network, prepared, others);
}
