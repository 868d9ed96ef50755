#include "fields.h"

enum { MAX_UVARINT_BYTES = 10 };

dfcgs_status dfcgs_raw(dfcgs_reader *r, uint64_t count, const uint8_t **bytes) {
    if (count > dfcgs_left(r))
        return dfcgs_refuse(r->error, r->shortage, dfcgs_offset(r), "bytes are missing");
    *bytes = r->data + r->at;
    r->at += (size_t)count;
    return DFCGS_OK;
}

dfcgs_status dfcgs_u8(dfcgs_reader *r, uint8_t *value) {
    const uint8_t *byte;
    DFCGS_TRY(dfcgs_raw(r, 1, &byte));
    *value = *byte;
    return DFCGS_OK;
}

dfcgs_status dfcgs_u32(dfcgs_reader *r, uint32_t *value) {
    const uint8_t *b;
    DFCGS_TRY(dfcgs_raw(r, 4, &b));
    *value = b[0] | (uint32_t)b[1] << 8 | (uint32_t)b[2] << 16 | (uint32_t)b[3] << 24;
    return DFCGS_OK;
}

dfcgs_status dfcgs_uvarint(dfcgs_reader *r, uint64_t *value) {
    int64_t start = dfcgs_offset(r);
    *value = 0;
    for (int i = 0; i < MAX_UVARINT_BYTES; i++) {
        uint8_t byte;
        DFCGS_TRY(dfcgs_u8(r, &byte));
        if (i == MAX_UVARINT_BYTES - 1 && byte > 1) break; /* beyond 64 bits, or an eleventh byte */
        *value |= (uint64_t)(byte & 127) << 7 * i;
        if (byte >= 128) continue;
        if (byte == 0 && i > 0) break;
        return DFCGS_OK;
    }
    return dfcgs_corrupt(r->error, start, "variable-length integer is not in its shortest form");
}

dfcgs_status dfcgs_svarint(dfcgs_reader *r, int64_t *value) {
    uint64_t folded;
    DFCGS_TRY(dfcgs_uvarint(r, &folded));
    *value = dfcgs_unfold(folded);
    return DFCGS_OK;
}

static dfcgs_status too_large(dfcgs_reader *r, int64_t offset) {
    return dfcgs_refuse(r->error, DFCGS_LIMIT, offset, "a field is above its limit");
}

dfcgs_status dfcgs_u8_most(dfcgs_reader *r, uint8_t limit, uint8_t *value) {
    int64_t offset = dfcgs_offset(r);
    DFCGS_TRY(dfcgs_u8(r, value));
    return *value > limit ? too_large(r, offset) : DFCGS_OK;
}

dfcgs_status dfcgs_uvarint_most(dfcgs_reader *r, uint64_t limit, uint64_t *value) {
    int64_t offset = dfcgs_offset(r);
    DFCGS_TRY(dfcgs_uvarint(r, value));
    return *value > limit ? too_large(r, offset) : DFCGS_OK;
}

dfcgs_status dfcgs_enum(dfcgs_reader *r, uint8_t count, uint8_t *value) {
    int64_t offset = dfcgs_offset(r);
    DFCGS_TRY(dfcgs_u8(r, value));
    if (*value < count) return DFCGS_OK;
    return dfcgs_refuse(r->error, DFCGS_UNSUPPORTED, offset, "a value is unknown: a newer decoder is needed");
}

dfcgs_status dfcgs_step_field(dfcgs_reader *r, int32_t *step) {
    int64_t offset = dfcgs_offset(r);
    uint64_t value;
    DFCGS_TRY(dfcgs_uvarint_most(r, DFCGS_STATE_LIMIT, &value));
    if (value == 0) return dfcgs_corrupt(r->error, offset, "a step is 0");
    *step = (int32_t)value;
    return DFCGS_OK;
}

dfcgs_status dfcgs_svarints_within(dfcgs_reader *r, int count, int64_t limit, int64_t *values) {
    int64_t offset = dfcgs_offset(r);
    int within = 1;
    for (int i = 0; i < count; i++) {
        DFCGS_TRY(dfcgs_svarint(r, &values[i]));
        within &= values[i] >= -limit && values[i] <= limit;
    }
    return within ? DFCGS_OK : too_large(r, offset);
}

dfcgs_status dfcgs_expect_end(dfcgs_reader *r) {
    return dfcgs_left(r) ? dfcgs_corrupt(r->error, dfcgs_offset(r), "unused bytes after the last field")
                         : DFCGS_OK;
}

uint32_t dfcgs_crc32(const uint8_t *data, size_t size) {
    uint32_t table[256], crc = 0xFFFFFFFFu;
    for (uint32_t i = 0; i < 256; i++) {
        uint32_t c = i;
        for (int k = 0; k < 8; k++) c = c >> 1 ^ (0xEDB88320u & -(c & 1));
        table[i] = c;
    }
    for (size_t i = 0; i < size; i++) crc = crc >> 8 ^ table[(crc ^ data[i]) & 255];
    return ~crc;
}
