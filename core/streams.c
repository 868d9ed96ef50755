#include "streams.h"

dfcgs_status dfcgs_open_streams(dfcgs_streams *streams, dfcgs_reader *reader, const uint64_t *lengths,
                                int count, dfcgs_stream stream) {
    uint64_t left = dfcgs_left(reader);
    for (int i = 0; i < count; i++) {
        if (lengths[i] > left) left = UINT64_MAX;
        if (left != UINT64_MAX) left -= lengths[i];
    }
    if (left)
        return dfcgs_corrupt(reader->error, dfcgs_offset(reader), "stream lengths do not fill the payload");
    *streams = (dfcgs_streams){.reader = reader, .lengths = lengths, .count = count, .stream = stream};
    return DFCGS_OK;
}

dfcgs_status dfcgs_next_stream(dfcgs_streams *streams, dfcgs_stream **stream) {
    const uint8_t *bytes;
    DFCGS_TRY(dfcgs_close_streams(streams));
    if (streams->next == streams->count) return DFCGS_MISUSE;
    int64_t offset = dfcgs_offset(streams->reader);
    uint64_t length = streams->lengths[streams->next++];
    DFCGS_TRY(dfcgs_raw(streams->reader, length, &bytes));
    *stream = &streams->stream;
    streams->is_open = 1;
    return dfcgs_start(&streams->stream, bytes, (size_t)length, offset);
}

dfcgs_status dfcgs_close_streams(dfcgs_streams *streams) {
    if (!streams->is_open) return DFCGS_OK;
    streams->is_open = 0;
    DFCGS_TRY(dfcgs_finish(&streams->stream));
    return streams->charge ? streams->charge(streams->whom, streams->stream.num_symbols) : DFCGS_OK;
}
