#include "motion_passes.h"

#include "side_information.h"

enum {
    FOLLOW = 1,
    MIXED = 2,
    NUM_MODES = 3,
    COLUMNS = DFCGS_CONTROL_COLUMNS,
    TRANSLATIONS = 3,
    PRESENT = 64
};
/* weights by what they are multiplied with */
enum { SYMBOL_WEIGHT = 256, SIXTEENTH_WEIGHT = 16 };

static dfcgs_status read_modes(dfcgs_stream *s, uint32_t num_blocks, uint8_t *modes) {
    uint8_t used[NUM_MODES], *found;
    dfcgs_model models[NUM_MODES];
    dfcgs_occurring(modes, num_blocks, NUM_MODES, used);
    DFCGS_GET(found, s->arena, uint8_t, num_blocks);
    DFCGS_TRY(dfcgs_read_histograms(s, used, NUM_MODES, NUM_MODES, models));
    DFCGS_TRY(dfcgs_grouped(s, modes, num_blocks, models, found));
    memcpy(modes, found, num_blocks);
    return DFCGS_OK;
}

/* Flags of the Gaussians `rows`, into `follows`. */
static dfcgs_status read_flags(dfcgs_stream *s, const uint32_t *rows, uint32_t num, const uint8_t *followed,
                               uint8_t *follows) {
    uint8_t used[2], *contexts, *found;
    dfcgs_model models[2];
    if (num == 0) return DFCGS_OK;
    DFCGS_GET(contexts, s->arena, uint8_t, num);
    DFCGS_GET(found, s->arena, uint8_t, num);
    for (uint32_t j = 0; j < num; j++) contexts[j] = followed[rows[j]];
    dfcgs_occurring(contexts, num, 2, used);
    DFCGS_TRY(dfcgs_read_histograms(s, used, 2, 2, models));
    DFCGS_TRY(dfcgs_grouped(s, contexts, num, models, found));
    for (uint32_t j = 0; j < num; j++) follows[rows[j]] = found[j];
    return DFCGS_OK;
}

dfcgs_status dfcgs_read_followers(dfcgs_stream *s, uint32_t count, uint8_t *modes, uint8_t *follows) {
    size_t mark = s->arena->used;
    uint32_t *rows, num = 0;
    uint8_t *followed;
    DFCGS_GET(rows, s->arena, uint32_t, count);
    DFCGS_GET(followed, s->arena, uint8_t, count);
    DFCGS_TRY(read_modes(s, dfcgs_num_blocks(count), modes));
    memcpy(followed, follows, count);
    for (uint32_t i = 0; i < count; i++) {
        uint8_t mode = modes[i >> DFCGS_BLOCK_LOG2];
        follows[i] = mode == FOLLOW;
        if (mode == MIXED) rows[num++] = i;
    }
    DFCGS_TRY(read_flags(s, rows, num, followed, follows));
    s->arena->used = mark;
    return DFCGS_OK;
}

/* Control points in the order of the stream: symbols before and now [n][6], expected changes [n][6],
   residuals of each column. */
typedef struct {
    dfcgs_stream *s;
    const dfcgs_symbol_part *part;
    uint32_t count;
    int32_t *before, *symbols, *prepared;
    int64_t *expected, *residuals[COLUMNS];
    uint8_t *others;
} walk;

static dfcgs_status take_walk(walk *w) {
    dfcgs_arena *arena = w->s->arena;
    size_t count = w->count;
    DFCGS_GET(w->before, arena, int32_t, count *COLUMNS);
    DFCGS_GET_ZEROS(w->symbols, arena, int32_t, count *COLUMNS);
    DFCGS_GET(w->expected, arena, int64_t, count *COLUMNS);
    DFCGS_GET(w->prepared, arena, int32_t, count *(size_t)dfcgs_prepared_width(&w->part->network));
    DFCGS_GET(w->others, arena, uint8_t, count *DFCGS_NUM_OTHERS);
    for (int c = 0; c < COLUMNS; c++) DFCGS_GET(w->residuals[c], arena, int64_t, count);
    return DFCGS_OK;
}

static dfcgs_status prepare(walk *w, const dfcgs_field *field, const uint32_t *order,
                            const dfcgs_motion_header *header, const int32_t *before) {
    size_t mark = w->s->arena->used;
    uint8_t *inputs, *ordered;
    int64_t *expected;
    DFCGS_GET(inputs, w->s->arena, uint8_t, (size_t)w->count *DFCGS_NUM_CONTROL_INPUTS);
    DFCGS_GET(ordered, w->s->arena, uint8_t, (size_t)w->count *DFCGS_NUM_CONTROL_INPUTS);
    DFCGS_GET(expected, w->s->arena, int64_t, (size_t)w->count *COLUMNS);
    dfcgs_control_inputs(field, before, header->translation_step, header->turn_step, inputs, expected);
    for (size_t j = 0; j < w->count; j++) {
        size_t k = order[j];
        memcpy(ordered + j * DFCGS_NUM_CONTROL_INPUTS, inputs + k * DFCGS_NUM_CONTROL_INPUTS,
               DFCGS_NUM_CONTROL_INPUTS);
        memcpy(w->expected + j * COLUMNS, expected + k * COLUMNS, COLUMNS * sizeof *expected);
        memcpy(w->before + j * COLUMNS, before + k * COLUMNS, COLUMNS * sizeof *before);
    }
    dfcgs_prepare(&w->part->network, ordered, w->count, w->prepared);
    w->s->arena->used = mark;
    return DFCGS_OK;
}

/* `weights`: of the neighbours' mean, of the residuals of up to five columns; at the end of the symbol
 * before, of habits. */
static dfcgs_status read_column(walk *w, const int32_t *weights, int c) {
    size_t mark = w->s->arena->used;
    dfcgs_levels levels = dfcgs_order_levels(w->count);
    int64_t *own;
    DFCGS_GET_ZEROS(own, w->s->arena, int64_t, w->count);
    for (int j = 0; j < c; j++)
        dfcgs_add_wide_feature(w->residuals[j], w->count, 1, weights[1 + j] * SYMBOL_WEIGHT, own);
    dfcgs_add_feature(w->before + c, w->count, COLUMNS, weights[COLUMNS] * SYMBOL_WEIGHT, own);
    dfcgs_add_wide_feature(w->expected + c, w->count, COLUMNS, weights[COLUMNS + 1] * SIXTEENTH_WEIGHT, own);
    dfcgs_other_inputs(w->before, w->symbols, w->count, COLUMNS, c, c >= TRANSLATIONS ? PRESENT : 0,
                       w->others);
    dfcgs_component component = {&w->part->network, w->prepared, w->others, NULL, own, weights[0]};
    DFCGS_TRY(dfcgs_prior_column(w->s, &levels, &component, w->part->tables, COLUMNS, w->symbols + c,
                                 w->residuals[c]));
    w->s->arena->used = mark;
    return DFCGS_OK;
}

dfcgs_status dfcgs_read_control(dfcgs_stream *s, const dfcgs_symbol_part *part,
                                int32_t (*weights)[DFCGS_CONTROL_WEIGHTS], const dfcgs_field *field,
                                const uint32_t *order, const dfcgs_motion_header *header, int32_t *symbols) {
    size_t mark = s->arena->used;
    walk w = {.s = s, .part = part, .count = field->count};
    int num_columns = header->turn_step ? COLUMNS : TRANSLATIONS;
    DFCGS_TRY(take_walk(&w));
    DFCGS_TRY(prepare(&w, field, order, header, symbols));
    for (int c = 0; c < num_columns; c++) DFCGS_TRY(read_column(&w, weights[c], c));
    for (size_t j = 0; j < w.count; j++)
        memcpy(symbols + order[j] * (size_t)COLUMNS, w.symbols + j * COLUMNS, COLUMNS * sizeof *symbols);
    s->arena->used = mark;
    return DFCGS_OK;
}
