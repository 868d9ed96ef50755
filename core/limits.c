#include "limits.h"

#define PROCESS ((int64_t)96 << 20)
#define FREE_MEMORY ((int64_t)256 << 20)
#define FREE_WORK ((int64_t)300000000)
enum { MEMORY_PER_BYTE = 4096, WORK_PER_BYTE = 100000 };

static int64_t intra_memory(int64_t count, int64_t columns) { return count * (850 + 27 * columns); }

static int64_t inter_memory(int64_t count, int64_t columns, int64_t coded) {
    return count * (1500 + 27 * columns + 65 * coded);
}

static int64_t intra_work(int64_t count, int64_t columns) {
    return 200000 * columns + count * (2500 + 130 * columns);
}

static int64_t output_work(int64_t count, int64_t columns) { return 200000 + count * (30 + 4 * columns); }

static int64_t inter_work(int64_t count, int64_t coded, int tools) {
    int64_t each = 0, fixed = 0;
    if (tools || coded) each = 150, fixed = 1000000;
    if (coded) each += 100 + 15 * coded, fixed += 20000 * coded;
    if (tools & DFCGS_MOTION) each += 400, fixed += 5000000;
    if (tools & DFCGS_TOPOLOGY) each += 1500;
    return fixed + count * each;
}

static int64_t control_work(int64_t count, const dfcgs_control_header *control) {
    return 3000 * count + 10 * (int64_t)dfcgs_wanted_points((uint32_t)count, control) * count;
}

static dfcgs_status refuse(dfcgs_budget *b, int kind, uint32_t frame, uint32_t count, int64_t value) {
    b->excess = (dfcgs_excess){kind, frame, count, value};
    return dfcgs_refuse(b->error, DFCGS_RESOURCES, DFCGS_NO_OFFSET,
                        "more than the limits of this decoder allow");
}

static dfcgs_status check_frame(dfcgs_budget *b, uint32_t frame, uint32_t count, int64_t memory) {
    memory += PROCESS;
    if (b->max_gaussians >= 0 && count > b->max_gaussians)
        return refuse(b, DFCGS_LIMIT_GAUSSIANS, frame, count, count);
    if (memory > b->max_memory) return refuse(b, DFCGS_LIMIT_MEMORY, frame, count, memory);
    if (b->max_gaussians < 0 && memory > FREE_MEMORY + MEMORY_PER_BYTE * b->bytes)
        return refuse(b, DFCGS_LIMIT_BOMB, frame, count, count);
    return DFCGS_OK;
}

static dfcgs_status spend(dfcgs_budget *b, uint32_t frame, uint32_t count, int64_t work) {
    b->work += work;
    if (b->max_gaussians < 0 && b->work > FREE_WORK + WORK_PER_BYTE * b->bytes)
        return refuse(b, DFCGS_LIMIT_WORK, frame, count, count);
    return DFCGS_OK;
}

void dfcgs_charge_bytes(dfcgs_budget *budget, uint64_t count) { budget->bytes += (int64_t)count; }

dfcgs_status dfcgs_charge_intra(dfcgs_budget *budget, uint32_t frame, uint32_t num_gaussians,
                                const dfcgs_control_header *control) {
    budget->control = *control;
    budget->has_control = 1;
    DFCGS_TRY(check_frame(budget, frame, num_gaussians, intra_memory(num_gaussians, budget->columns)));
    return spend(budget, frame, num_gaussians,
                 intra_work(num_gaussians, budget->columns) + output_work(num_gaussians, budget->columns));
}

dfcgs_status dfcgs_charge_inter(dfcgs_budget *budget, uint32_t frame, uint32_t num_gaussians,
                                const dfcgs_inter_header *header) {
    int64_t coded = 0, work;
    for (int a = 0; a < DFCGS_MAX_ATTRIBUTES; a++)
        if (header->mask >> a & 1) coded += dfcgs_columns(a);
    work = output_work(num_gaussians, budget->columns) + inter_work(num_gaussians, coded, header->tools);
    if (header->tools & ~DFCGS_VISIBILITY && budget->has_control) {
        work += control_work(num_gaussians, &budget->control);
        budget->has_control = 0;
    }
    if (header->tools || header->mask)
        DFCGS_TRY(
            check_frame(budget, frame, num_gaussians, inter_memory(num_gaussians, budget->columns, coded)));
    return spend(budget, frame, num_gaussians, work);
}

dfcgs_status dfcgs_charge_births(dfcgs_budget *budget, uint32_t frame, uint32_t num_births,
                                 uint32_t num_gaussians) {
    int64_t memory = intra_memory(num_births, budget->columns);
    memory += inter_memory(num_gaussians, budget->columns, budget->columns);
    DFCGS_TRY(check_frame(budget, frame, num_gaussians, memory));
    return spend(budget, frame, num_gaussians, intra_work(num_births, budget->columns));
}

dfcgs_status dfcgs_charge_symbols(dfcgs_budget *budget, uint32_t frame, uint32_t num_gaussians,
                                  uint64_t num_symbols) {
    return spend(budget, frame, num_gaussians, 250 * (int64_t)num_symbols);
}
