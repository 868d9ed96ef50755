#include "output.h"

#include "companding.h"

static float power_of_two(int exponent) {
    uint32_t bits = (uint32_t)(127 + exponent) << 23;
    float power;
    memcpy(&power, &bits, sizeof power);
    return power;
}

static size_t place_of(const int32_t *order, uint32_t i) { return order ? (size_t)order[i] : i; }

/* Conversion rounds once, and a power of two changes no digit. */
static void scale_row(const int32_t *values, int columns, float unit, float *floats) {
    for (int c = 0; c < columns; c++) floats[c] = (float)values[c] * unit;
}

void dfcgs_floats(const int32_t *values, uint32_t count, int columns, int exponent, const int32_t *order,
                  float *floats) {
    float unit = power_of_two(exponent);
    size_t width = (size_t)columns;
    if (!order) {
        for (size_t i = 0; i < count * width; i++) floats[i] = (float)values[i] * unit;
        return;
    }
    for (uint32_t i = 0; i < count; i++)
        scale_row(values + i * width, columns, unit, floats + place_of(order, i) * width);
}

void dfcgs_double_positions(const int32_t *positions, uint32_t count, const int64_t origin[3], int exponent,
                            const int32_t *order, double *doubles) {
    double unit = power_of_two(exponent);
    for (uint32_t i = 0; i < count; i++)
        for (size_t a = 0; a < 3; a++)
            doubles[3 * place_of(order, i) + a] = (double)(positions[3 * (size_t)i + a] + origin[a]) * unit;
}

void dfcgs_float_positions(const int32_t *positions, uint32_t count, const int64_t origin[3], int exponent,
                           const int32_t *order, float *floats) {
    double unit = power_of_two(exponent);
    for (uint32_t i = 0; i < count; i++)
        for (size_t a = 0; a < 3; a++)
            floats[3 * place_of(order, i) + a] =
                (float)((double)(positions[3 * (size_t)i + a] + origin[a]) * unit);
}

void dfcgs_float_logits(const int32_t *opacities, uint32_t count, int exponent, const int32_t *order,
                        float *floats) {
    dfcgs_knots knots = dfcgs_opacity_knots(exponent);
    float unit = power_of_two(exponent);
    for (uint32_t i = 0; i < count; i++)
        floats[place_of(order, i)] = (float)dfcgs_expand(&knots, opacities[i]) * unit;
}

/* Puts the coefficients of one band, `width` columns of three channels each, into their places from `at` on.
 */
static void spread_band(const int32_t *values, int width, int at, int most, float unit, float *floats) {
    for (int k = 0; k < width; k++)
        for (int channel = 0; channel < 3; channel++)
            floats[channel * most + at + k] = (float)values[3 * k + channel] * unit;
}

void dfcgs_float_bands(const int32_t *first, const int32_t *second, const int32_t *third, uint32_t count,
                       int exponent, const int32_t *order, float *floats) {
    int most = third ? 15 : second ? 8 : first ? 3 : 0;
    float unit = power_of_two(exponent);
    for (uint32_t i = 0; i < count; i++) {
        float *row = floats + place_of(order, i) * (size_t)(3 * most);
        if (first) spread_band(first + 9 * (size_t)i, 3, 0, most, unit, row);
        if (second) spread_band(second + 15 * (size_t)i, 5, 3, most, unit, row);
        if (third) spread_band(third + 21 * (size_t)i, 7, 8, most, unit, row);
    }
}
