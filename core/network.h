/* 17.1 The networks of the frozen prior: what is known of a symbol to its class.

   Sums are below 2**24 by the bound that a model keeps, inputs and activations below 2**10, so that products
   of 16 bits do. */
#ifndef DFCGS_NETWORK_H
#define DFCGS_NETWORK_H

#include "core.h"

enum { DFCGS_INPUT_LIMIT = 255, DFCGS_ACTIVATION_LIMIT = 1023, DFCGS_MAX_LAYERS = 4, DFCGS_MAX_WIDTH = 64 };
/* outputs of a layer that are found together, and inputs that are multiplied together */
enum { DFCGS_GROUP = 16, DFCGS_PAIR = 2 };

/* Weights [groups][pairs][16][2], filled up with zeros; a last layer, which has one output: [pairs][2]. */
typedef struct {
    int groups, pairs, shift, limit;
    const int16_t *weights;
    const int32_t *bias; /* [16 * groups] */
} dfcgs_layer;

/* `common`: what the first inputs, which all symbols of a Gaussian share, add to the first layer's sums. */
typedef struct {
    int num_layers, num_common, num_others;
    int is_narrow; /* no layer has more than 16 outputs, and there are no more than 16 others */
    dfcgs_layer common, layers[DFCGS_MAX_LAYERS];
} dfcgs_network;

/* A network from `words`: the number of layers, then for each outputs, inputs, shift, limit, biases, and
   weights row by row. All else is refused with DFCGS_MODEL. What it needs lies in `arena`; `used`: words
   read. */
DFCGS_EXPORT dfcgs_status dfcgs_read_network(dfcgs_arena *arena, const int32_t *words, uint32_t count,
                                             int num_common, int num_others, int num_classes,
                                             dfcgs_network *network, uint32_t *used);

/* Sums that the `common` inputs of a Gaussian make: 16 times the groups of the first layer. */
DFCGS_INLINE int dfcgs_prepared_width(const dfcgs_network *network) {
    return DFCGS_GROUP * network->common.groups;
}
/* `common` [rows][num_common] to `prepared` [rows][dfcgs_prepared_width]. */
DFCGS_EXPORT void dfcgs_prepare(const dfcgs_network *network, const uint8_t *common, uint32_t rows,
                                int32_t *prepared);

/* The class of a symbol from what dfcgs_prepare gave and its `others` [num_others]. */
uint8_t dfcgs_class(const dfcgs_network *network, const int32_t *prepared, const uint8_t *others);
/* The same of up to 16 others in the bytes of two words, the first one lowest; those left over are 0. */
uint8_t dfcgs_class_of_words(const dfcgs_network *network, const int32_t *prepared, uint64_t low,
                             uint64_t high);
/* The classes of `rows` symbols, one after the other. */
DFCGS_EXPORT void dfcgs_classes(const dfcgs_network *network, const int32_t *prepared, const uint8_t *others,
                                uint32_t rows, uint8_t *classes);

#endif
