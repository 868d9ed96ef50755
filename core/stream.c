#include "stream.h"

enum {
    MAX_UNIFORM_BITS = 16,
    ESCAPE_LENGTH_BITS = 5,
    NUM_LENGTHS = 32,
    START_SHIFT = DFCGS_FREQUENCY_BITS - 8
};
#define MAX_QUANTILE (((uint64_t)1 << DFCGS_FREQUENCY_BITS) - 1)
#define WORD_LIMIT ((uint64_t)1 << 32)

static uint32_t read_word(dfcgs_stream *s) {
    uint32_t word;
    if (s->next == s->num_words) return 0;
    memcpy(&word, s->words + 4 * (size_t)s->next++, 4);
    return word;
}

dfcgs_status dfcgs_start(dfcgs_stream *s, const uint8_t *bytes, size_t size, int64_t offset) {
    if (size % 4 || size / 4 > UINT32_MAX)
        return dfcgs_corrupt(s->error, offset, "a range-coded stream is not a whole number of words");
    s->words = bytes;
    s->num_words = (uint32_t)(size / 4);
    s->next = 0;
    s->range = UINT64_MAX;
    s->ahead = (uint64_t)read_word(s) << 32;
    s->ahead |= read_word(s);
    s->num_symbols = 0;
    s->offset = offset;
    return DFCGS_OK;
}

dfcgs_status dfcgs_finish(dfcgs_stream *s) {
    if (s->next == s->num_words && (s->range == UINT64_MAX || s->ahead < 2 * WORD_LIMIT - 1)) return DFCGS_OK;
    return dfcgs_corrupt(s->error, s->offset, "unused words in a range-coded stream");
}

static dfcgs_status lost(dfcgs_stream *s) {
    return dfcgs_corrupt(s->error, s->offset, "range decoder lost its way");
}

/* Consumes a symbol of which `start` and `frequency` are known. */
static inline void consume(dfcgs_stream *s, uint64_t scale, uint32_t start, uint32_t frequency) {
    s->ahead -= scale * start;
    s->range = scale * frequency;
    if (s->range < WORD_LIMIT) {
        s->range <<= 32;
        s->ahead = s->ahead << 32 | read_word(s);
    }
}

/* The next symbol; UINT32_MAX where there is none. `s` is a copy that lives in registers. */
static inline uint32_t next_symbol(dfcgs_stream *s, const uint32_t *cumulative, const uint16_t *starts) {
    uint64_t scale = s->range >> DFCGS_FREQUENCY_BITS, quantile = s->ahead / scale;
    if (quantile > MAX_QUANTILE) return UINT32_MAX;
    uint32_t symbol = starts ? starts[quantile >> START_SHIFT] : 0;
    while (cumulative[symbol + 1] <= quantile) symbol++;
    consume(s, scale, cumulative[symbol], cumulative[symbol + 1] - cumulative[symbol]);
    return symbol;
}

dfcgs_status dfcgs_decode(dfcgs_stream *s, const dfcgs_model *model, uint32_t count, uint16_t *symbols) {
    dfcgs_stream own = *s;
    own.num_symbols += count;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t symbol = next_symbol(&own, model->cumulative, model->start);
        if (symbol == UINT32_MAX) return lost(s);
        symbols[i] = (uint16_t)symbol;
    }
    *s = own;
    return DFCGS_OK;
}

/* The next symbol of uniform(2**bits); UINT32_MAX where there is none. */
static inline uint32_t next_bits(dfcgs_stream *s, int bits) {
    int shift = DFCGS_FREQUENCY_BITS - bits;
    uint64_t scale = s->range >> DFCGS_FREQUENCY_BITS, symbol = s->ahead / (scale << shift);
    if (symbol >> bits) return UINT32_MAX;
    consume(s, scale, (uint32_t)symbol << shift, 1u << shift);
    return (uint32_t)symbol;
}

dfcgs_status dfcgs_choice(dfcgs_stream *s, int bits, uint32_t *symbol) {
    s->num_symbols++;
    *symbol = next_bits(s, bits);
    return *symbol == UINT32_MAX ? lost(s) : DFCGS_OK;
}

dfcgs_status dfcgs_bits(dfcgs_stream *s, int width, uint32_t count, uint64_t *values) {
    dfcgs_stream own = *s;
    memset(values, 0, (size_t)count * sizeof *values);
    for (int shift = 0; shift < width; shift += MAX_UNIFORM_BITS) {
        int bits = width - shift < MAX_UNIFORM_BITS ? width - shift : MAX_UNIFORM_BITS;
        own.num_symbols += count;
        for (uint32_t i = 0; i < count; i++) {
            uint32_t part = next_bits(&own, bits);
            if (part == UINT32_MAX) return lost(s);
            values[i] |= (uint64_t)part << shift;
        }
    }
    *s = own;
    return DFCGS_OK;
}

/* --- 10.8 --------------------------------------------------------------------------------------------------
 */

/* The low bits of all values of one length, which are rows `order`. */
static dfcgs_status escapes_of_length(dfcgs_stream *s, int length, const uint32_t *order, uint32_t count,
                                      uint64_t *low, uint64_t *values) {
    DFCGS_TRY(dfcgs_bits(s, length, count, low));
    for (uint32_t j = 0; j < count; j++) values[order[j]] = low[j] + ((uint64_t)1 << length) - 1;
    return DFCGS_OK;
}

dfcgs_status dfcgs_escapes(dfcgs_stream *s, uint32_t count, uint64_t *values) {
    size_t mark = s->arena->used;
    uint8_t *lengths;
    uint32_t *order, first[257];
    uint64_t *low;
    DFCGS_GET(lengths, s->arena, uint8_t, count);
    DFCGS_GET(order, s->arena, uint32_t, count);
    DFCGS_GET(low, s->arena, uint64_t, count);
    for (uint32_t i = 0; i < count; i++) {
        uint32_t length;
        DFCGS_TRY(dfcgs_choice(s, ESCAPE_LENGTH_BITS, &length));
        lengths[i] = (uint8_t)length;
    }
    dfcgs_group(lengths, count, order, first);
    for (int n = 0; n < NUM_LENGTHS; n++)
        DFCGS_TRY(escapes_of_length(s, n, order + first[n], first[n + 1] - first[n], low, values));
    s->arena->used = mark;
    return DFCGS_OK;
}

dfcgs_status dfcgs_count_value(dfcgs_stream *s, uint64_t limit, uint64_t *value) {
    DFCGS_TRY(dfcgs_escapes(s, 1, value));
    return *value > limit ? dfcgs_corrupt(s->error, DFCGS_NO_OFFSET, "a coded count is too large") : DFCGS_OK;
}

dfcgs_status dfcgs_signed_value(dfcgs_stream *s, uint64_t limit, int64_t *value) {
    uint64_t folded;
    DFCGS_TRY(dfcgs_count_value(s, 2 * limit, &folded));
    *value = (int64_t)(folded >> 1) ^ -(int64_t)(folded & 1);
    return DFCGS_OK;
}

/* --- 10.9 --------------------------------------------------------------------------------------------------
 */

void dfcgs_group(const uint8_t *contexts, uint32_t count, uint32_t *order, uint32_t *first) {
    uint32_t place[256];
    memset(first, 0, 257 * sizeof *first);
    for (uint32_t i = 0; i < count; i++) first[contexts[i] + 1]++;
    for (int c = 0; c < 256; c++) first[c + 1] += first[c];
    memcpy(place, first, sizeof place);
    for (uint32_t i = 0; i < count; i++) order[place[contexts[i]]++] = i;
}

static dfcgs_status group_symbols(dfcgs_stream *s, const dfcgs_model *model, const uint32_t *order,
                                  uint32_t count, uint8_t *symbols) {
    dfcgs_stream own = *s;
    own.num_symbols += count;
    for (uint32_t j = 0; j < count; j++) {
        uint32_t symbol = next_symbol(&own, model->cumulative, model->start);
        if (symbol == UINT32_MAX) return lost(s);
        symbols[order[j]] = (uint8_t)symbol;
    }
    *s = own;
    return DFCGS_OK;
}

dfcgs_status dfcgs_grouped(dfcgs_stream *s, const uint8_t *contexts, uint32_t count,
                           const dfcgs_model *models, uint8_t *symbols) {
    size_t mark = s->arena->used;
    uint32_t *order, first[257];
    DFCGS_GET(order, s->arena, uint32_t, count);
    dfcgs_group(contexts, count, order, first);
    for (int c = 0; c < 256; c++)
        if (first[c] < first[c + 1])
            DFCGS_TRY(group_symbols(s, &models[c], order + first[c], first[c + 1] - first[c], symbols));
    s->arena->used = mark;
    return DFCGS_OK;
}

/* --- 10.10 -------------------------------------------------------------------------------------------------
 */

/* Table symbols of one context; the rows that are escapes go to `escaped`. */
static dfcgs_status table_symbols(dfcgs_stream *s, const dfcgs_model *model, const uint32_t *order,
                                  uint32_t count, int64_t *values, uint32_t *escaped, uint32_t *num_escaped) {
    dfcgs_stream own = *s;
    uint32_t last = model->size - 1, found = *num_escaped;
    int32_t reach = (int32_t)(model->size / 2);
    own.num_symbols += count;
    for (uint32_t j = 0; j < count; j++) {
        uint32_t symbol = next_symbol(&own, model->cumulative, model->start);
        if (symbol - 1 >= last - 1) { /* 0, the last one, or none */
            if (symbol == UINT32_MAX) return lost(s);
            escaped[found++] = order[j];
        }
        values[order[j]] = (int32_t)symbol - reach;
    }
    *num_escaped = found;
    *s = own;
    return DFCGS_OK;
}

static dfcgs_status add_excess(dfcgs_stream *s, const uint32_t *escaped, uint32_t count, int64_t *values) {
    size_t mark = s->arena->used;
    uint64_t *excess;
    if (count == 0) return DFCGS_OK;
    DFCGS_GET(excess, s->arena, uint64_t, count);
    DFCGS_TRY(dfcgs_escapes(s, count, excess));
    for (uint32_t j = 0; j < count; j++)
        values[escaped[j]] += dfcgs_sign(values[escaped[j]]) * (int64_t)excess[j];
    s->arena->used = mark;
    return DFCGS_OK;
}

static dfcgs_status append_low_bits(dfcgs_stream *s, int low_bits, const uint32_t *order, uint32_t count,
                                    int64_t *values) {
    size_t mark = s->arena->used;
    uint64_t *low;
    DFCGS_GET(low, s->arena, uint64_t, count);
    DFCGS_TRY(dfcgs_bits(s, low_bits, count, low));
    for (uint32_t j = 0; j < count; j++)
        values[order[j]] = dfcgs_shift(values[order[j]], low_bits) | (int64_t)low[j];
    s->arena->used = mark;
    return DFCGS_OK;
}

dfcgs_status dfcgs_residuals(dfcgs_stream *s, const uint8_t *contexts, uint32_t count,
                             const dfcgs_table *tables, int64_t *values) {
    size_t mark = s->arena->used;
    uint32_t *order, *escaped, first[257], num_escaped = 0;
    DFCGS_GET(order, s->arena, uint32_t, count);
    DFCGS_GET(escaped, s->arena, uint32_t, count);
    dfcgs_group(contexts, count, order, first);
    for (int c = 0; c < 256; c++)
        if (first[c] < first[c + 1])
            DFCGS_TRY(table_symbols(s, tables[c].model, order + first[c], first[c + 1] - first[c], values,
                                    escaped, &num_escaped));
    DFCGS_TRY(add_excess(s, escaped, num_escaped, values));
    for (int c = 0; c < 256; c++)
        if (first[c] < first[c + 1] && tables[c].low_bits)
            DFCGS_TRY(
                append_low_bits(s, tables[c].low_bits, order + first[c], first[c + 1] - first[c], values));
    s->arena->used = mark;
    return DFCGS_OK;
}

dfcgs_status dfcgs_flat(dfcgs_stream *s, int table, uint32_t count, int64_t *values) {
    size_t mark = s->arena->used;
    dfcgs_table tables[1] = {dfcgs_table_of(s->models, table)};
    uint8_t *contexts;
    DFCGS_GET_ZEROS(contexts, s->arena, uint8_t, count);
    DFCGS_TRY(dfcgs_residuals(s, contexts, count, tables, values));
    s->arena->used = mark;
    return DFCGS_OK;
}
