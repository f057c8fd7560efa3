/*
 * Reader of MantaRay travel-time tables (.mtt files), C99, header only.
 *
 * SPDX-License-Identifier: MIT
 * Copyright (c) MantaRay developers
 *
 * The caller loads the file into memory (or links it into the firmware) and keeps it there:
 *
 *     mantaray_table table;
 *     if (mantaray_table_open(&table, bytes, size) != MANTARAY_OK) ...
 *     mantaray_result r;
 *     mantaray_horizontal_range(&table, source_depth, receiver_depth, travel_time, bearing, &r);
 *     if (mantaray_has_range(r.status)) use(r.horizontal_range);
 *
 * No allocation, no dependency except <math.h> for sqrt, floor and fmod, no global state. mantaray_table_open checks
 * a checksum and every index of the table once, so that no later look-up reads outside the bytes or runs forever.
 * Lengths in metres, times in seconds, angles in radians. The bytes are little-endian, whatever the machine is.
 * Results equal those of the Python reader bit for bit if the compiler does not contract products and sums
 * (GCC and Clang: -ffp-contract=off).
 */
#ifndef MANTARAY_TABLE_H
#define MANTARAY_TABLE_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Outcome of a look-up. The first three have a range. */
enum mantaray_status {
    MANTARAY_DIRECT = 0,    /* one arrival without reflections */
    MANTARAY_BOUNCED = 1,   /* the selected arrival is reflected */
    MANTARAY_AMBIGUOUS = 2, /* other arrivals have the same numbers of reflections; the selected one is given */
    MANTARAY_SHADOW = 3,    /* no arrival */
    MANTARAY_BORDER = 4,    /* next to a shadow or between two families of arrivals: not interpolated */
    MANTARAY_OUTSIDE = 5    /* outside the limits of the table, or outside the water */
};

/* Outcome of mantaray_table_open. */
enum mantaray_error {
    MANTARAY_OK = 0,
    MANTARAY_NOT_A_TABLE = 1,   /* too short, or other first bytes */
    MANTARAY_OTHER_FORMAT = 2,  /* written by another version */
    MANTARAY_TRUNCATED = 3,     /* fewer bytes than the header needs */
    MANTARAY_DAMAGED = 4,       /* limits, indices or values are invalid */
    MANTARAY_CHECKSUM = 5       /* the bytes do not have their checksum, or there are more of them */
};

typedef struct {
    const unsigned char *root, *branch, *corner, *value, *sigma, *status, *surface_bounces, *bottom_bounces;
    uint32_t sectors, branches, cells, corners, sigmas;
    double lower[3], upper[3]; /* source depth, receiver depth, horizontal range */
    double tolerance;          /* bound of the error of an interpolated range */
    double typical;            /* mean slowness at the first corner, with which searches begin */
} mantaray_table;

typedef struct {
    int status;
    int surface_bounces, bottom_bounces;
    double horizontal_range;        /* NaN, like all below, without a range */
    double travel_time;
    double range_by_time;           /* derivative of range by travel time */
    double range_by_source_depth;   /* at constant travel time */
    double range_by_receiver_depth; /* at constant travel time */
    double range_by_scale;          /* by the logarithm of a factor of all sound speeds */
    double range_sigma;             /* standard deviation over the ensemble of oceans; NaN if unknown */
} mantaray_result;

static inline int mantaray_has_range(int status) { return status >= 0 && status <= MANTARAY_AMBIGUOUS; }

static inline uint32_t mantaray_u32(const unsigned char *p) {
    return (uint32_t)p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24;
}

static inline double mantaray_f32(const unsigned char *p) {
    uint32_t bits = mantaray_u32(p);
    float number;
    memcpy(&number, &bits, sizeof number);
    return (double)number;
}

static inline double mantaray_f64(const unsigned char *p) {
    uint64_t bits = (uint64_t)mantaray_u32(p) | (uint64_t)mantaray_u32(p + 4) << 32;
    double number;
    memcpy(&number, &bits, sizeof number);
    return number;
}

/* CRC-32 (ISO 3309, as in zlib) of some bytes. */
static inline uint32_t mantaray_crc32(const unsigned char *p, size_t size) {
    uint32_t crc = 0xffffffffu;
    for (size_t i = 0; i < size; i++) {
        crc ^= p[i];
        for (int k = 0; k < 8; k++) crc = (crc >> 1) ^ (0xedb88320u & (0u - (crc & 1u)));
    }
    return crc ^ 0xffffffffu;
}

static inline int mantaray_is_finite(double x) { return x - x == 0.0; }

/* Check every index and value once. */
static inline int mantaray_check(const mantaray_table *t) {
    for (int k = 0; k < 3; k++) {
        if (!mantaray_is_finite(t->lower[k]) || !mantaray_is_finite(t->upper[k]) || !(t->lower[k] < t->upper[k]))
            return MANTARAY_DAMAGED;
    }
    if (t->sectors == 0 || (t->sigmas != 0 && t->sigmas != t->corners)) return MANTARAY_DAMAGED;
    for (uint32_t i = 0; i < t->sectors; i++) {
        if (mantaray_u32(t->root + 4 * (size_t)i) >= t->branches) return MANTARAY_DAMAGED;
    }
    for (uint32_t i = 0; i < t->branches; i++) {
        uint32_t word = mantaray_u32(t->branch + 4 * (size_t)i), content = word >> 2;
        if ((word & 3u) != 3u) { /* halves follow their whole, so that every descent ends */
            if (content <= i || content >= t->branches - 1u) return MANTARAY_DAMAGED;
        } else if (content & 1u) {
            if (content >> 1 >= t->cells) return MANTARAY_DAMAGED;
        } else if (content >> 1 > MANTARAY_OUTSIDE) {
            return MANTARAY_DAMAGED;
        }
    }
    for (size_t i = 0; i < 8 * (size_t)t->cells; i++) {
        if (mantaray_u32(t->corner + 4 * i) >= t->corners) return MANTARAY_DAMAGED;
    }
    for (size_t i = 0; i < t->cells; i++) {
        if (t->status[i] > MANTARAY_AMBIGUOUS) return MANTARAY_DAMAGED;
    }
    for (size_t i = 0; i < 4 * (size_t)t->corners; i++) {
        if (!mantaray_is_finite(mantaray_f32(t->value + 4 * i))) return MANTARAY_DAMAGED;
    }
    for (size_t i = 0; i < t->sigmas; i++) {
        if (!mantaray_is_finite(mantaray_f32(t->sigma + 4 * i))) return MANTARAY_DAMAGED;
    }
    return MANTARAY_OK;
}

/* Open a table in memory; the bytes must stay where they are. Returns MANTARAY_OK or an error. */
static inline int mantaray_table_open(mantaray_table *t, const void *bytes, size_t size) {
    const unsigned char *p = (const unsigned char *)bytes;
    const size_t header = 8 + 6 * 4 + 7 * 8;
    memset(t, 0, sizeof *t);
    if (p == NULL || size < header || memcmp(p, "MANTATAB", 8) != 0) return MANTARAY_NOT_A_TABLE;
    if (mantaray_u32(p + 8) != 2u) return MANTARAY_OTHER_FORMAT;
    t->sectors = mantaray_u32(p + 12);
    t->branches = mantaray_u32(p + 16);
    t->cells = mantaray_u32(p + 20);
    t->corners = mantaray_u32(p + 24);
    t->sigmas = mantaray_u32(p + 28);
    for (int k = 0; k < 3; k++) {
        t->lower[k] = mantaray_f64(p + 32 + 8 * k);
        t->upper[k] = mantaray_f64(p + 56 + 8 * k);
    }
    t->tolerance = mantaray_f64(p + 80);
    /* at most 4 * 2^32 * 16 bytes: no overflow in 64 bits */
    uint64_t need = (uint64_t)header + 4u + 4u * (uint64_t)t->sectors + 4u * (uint64_t)t->branches
                  + 35u * (uint64_t)t->cells + 16u * (uint64_t)t->corners + 4u * (uint64_t)t->sigmas;
    if (need > (uint64_t)size) return MANTARAY_TRUNCATED;
    if (need < (uint64_t)size || mantaray_crc32(p, size - 4) != mantaray_u32(p + size - 4)) return MANTARAY_CHECKSUM;
    t->root = p + header;
    t->branch = t->root + 4 * (size_t)t->sectors;
    t->corner = t->branch + 4 * (size_t)t->branches;
    t->value = t->corner + 32 * (size_t)t->cells;
    t->sigma = t->value + 16 * (size_t)t->corners;
    t->status = t->sigma + 4 * (size_t)t->sigmas;
    t->surface_bounces = t->status + t->cells;
    t->bottom_bounces = t->surface_bounces + t->cells;
    t->typical = (1.0 + (t->corners ? mantaray_f32(t->value) : 0.0)) * (1.0 / 1500.0);
    return mantaray_check(t);
}

typedef struct {
    int status;
    int64_t number; /* of the cell; -1 without an arrival */
    double at[3], size[3];
} mantaray_cell;

/* Descend to the cell that contains a place; a sector that the table does not have is outside. */
static inline void mantaray_find(const mantaray_table *t, uint32_t sector, const double place[3], mantaray_cell *cell) {
    double low[3];
    for (int k = 0; k < 3; k++) {
        if (!(place[k] >= t->lower[k] && place[k] <= t->upper[k]) || sector >= t->sectors) {
            cell->status = MANTARAY_OUTSIDE;
            cell->number = -1;
            return;
        }
        low[k] = t->lower[k];
        cell->size[k] = t->upper[k] - t->lower[k];
    }
    uint32_t word = mantaray_u32(t->branch + 4 * (size_t)mantaray_u32(t->root + 4 * (size_t)sector));
    while ((word & 3u) != 3u) {
        uint32_t axis = word & 3u, next = word >> 2;
        double half = 0.5 * cell->size[axis], middle = low[axis] + half;
        if (place[axis] >= middle) {
            low[axis] = middle;
            next += 1u;
        }
        cell->size[axis] = half;
        word = mantaray_u32(t->branch + 4 * (size_t)next);
    }
    uint32_t content = word >> 2;
    if (content & 1u) {
        cell->number = (int64_t)(content >> 1);
        cell->status = t->status[content >> 1];
    } else {
        cell->number = -1;
        cell->status = (int)(content >> 1);
    }
    for (int k = 0; k < 3; k++) cell->at[k] = (place[k] - low[k]) / cell->size[k];
}

/* Interpolate values at the corners; the value and its derivatives by the coordinates. */
static inline double mantaray_interpolate(
    const double at[3], const double size[3], double corner[8][4], double gradient[3]) {
    double weight[2][3], value = 0.0, derivative[3] = {0.0, 0.0, 0.0};
    for (int k = 0; k < 3; k++) {
        weight[0][k] = 1.0 - at[k];
        weight[1][k] = at[k];
    }
    for (int c = 0; c < 8; c++) {
        int i = c & 1, j = c >> 1 & 1, k = c >> 2 & 1;
        double x = weight[i][0], y = weight[j][1], z = weight[k][2], f = corner[c][0];
        value += x * y * z * f;
        derivative[0] += (i ? 1.0 : -1.0) * (y * z * f);
        derivative[1] += (j ? 1.0 : -1.0) * (x * z * f);
        derivative[2] += (k ? 1.0 : -1.0) * (x * y * f);
    }
    for (int axis = 0; axis < 3; axis++) {
        int u = (axis + 1) % 3, v = (axis + 2) % 3;
        double s = at[axis];
        double left = s * (1.0 - s) * (1.0 - s), right = s * s * (1.0 - s);
        double left_slope = (1.0 - s) * (1.0 - 3.0 * s), right_slope = s * (2.0 - 3.0 * s);
        for (int side = 0; side < 4; side++) {
            int p = side & 1, q = side >> 1, low = (p << u) + (q << v), high = low + (1 << axis);
            double step = corner[high][0] - corner[low][0];
            double first = corner[low][1 + axis] * size[axis] - step;
            double last = step - corner[high][1 + axis] * size[axis];
            double excess = left * first + right * last;
            double a = weight[p][u], b = weight[q][v];
            value += a * b * excess;
            derivative[axis] += a * b * (left_slope * first + right_slope * last);
            derivative[u] += (p ? 1.0 : -1.0) * (b * excess);
            derivative[v] += (q ? 1.0 : -1.0) * (a * excess);
        }
    }
    for (int k = 0; k < 3; k++) gradient[k] = derivative[k] / size[k];
    return value;
}

/* Relative mean slowness in a cell with an arrival, its derivatives, and its standard deviation. */
static inline double mantaray_mean(const mantaray_table *t, const mantaray_cell *cell, double gradient[3], double *sigma) {
    double corner[8][4], spread[8][4], unused[3];
    const unsigned char *rows = t->corner + 32 * (size_t)cell->number;
    for (int c = 0; c < 8; c++) {
        size_t row = mantaray_u32(rows + 4 * c);
        for (int k = 0; k < 4; k++) corner[c][k] = mantaray_f32(t->value + 16 * row + 4 * k);
        spread[c][0] = t->sigmas ? mantaray_f32(t->sigma + 4 * row) : 0.0;
        spread[c][1] = spread[c][2] = spread[c][3] = 0.0;
    }
    if (sigma != NULL) *sigma = t->sigmas ? mantaray_interpolate(cell->at, cell->size, spread, unused) : (double)NAN;
    return mantaray_interpolate(cell->at, cell->size, corner, gradient);
}

/* Sector of a bearing. If there are several, a bearing that is not finite is in none. */
static inline uint32_t mantaray_sector(const mantaray_table *t, double bearing) {
    const double turn = 6.283185307179586;
    double part = fmod(bearing, turn);
    if (!mantaray_is_finite(part)) return t->sectors > 1u ? t->sectors : 0u;
    if (part < 0.0) part += turn;
    return (uint32_t)((int64_t)floor(part / turn * (double)t->sectors + 0.5) % (int64_t)t->sectors);
}

#define MANTARAY_SLOWNESS (1.0 / 1500.0) /* s/m; a table stores relative differences from it */

/* All quantities at a place; the travel time is interpolated if time is NULL. */
static inline void mantaray_look_up(
    const mantaray_table *t, uint32_t sector, const double place[3], const double *time, mantaray_result *r) {
    mantaray_cell cell;
    double gradient[3], sigma;
    mantaray_find(t, sector, place, &cell);
    r->status = cell.status;
    r->surface_bounces = r->bottom_bounces = 0;
    r->horizontal_range = r->travel_time = r->range_by_time = r->range_by_source_depth = (double)NAN;
    r->range_by_receiver_depth = r->range_by_scale = r->range_sigma = (double)NAN;
    if (cell.number < 0) return;
    double mean = mantaray_mean(t, &cell, gradient, &sigma);
    double down = place[1] - place[0], distance = place[2];
    double straight = sqrt(distance * distance + down * down);
    double slowness = (1.0 + mean) * MANTARAY_SLOWNESS;
    double by_range = straight * gradient[2] * MANTARAY_SLOWNESS + slowness * distance / straight;
    double by_source = straight * gradient[0] * MANTARAY_SLOWNESS - slowness * down / straight;
    double by_receiver = straight * gradient[1] * MANTARAY_SLOWNESS + slowness * down / straight;
    double interpolated = straight * slowness;
    if (time != NULL && !(fabs(interpolated - *time) <= 1e-9 * *time)) { /* the search met places without an arrival */
        r->status = MANTARAY_BORDER;
        return;
    }
    r->surface_bounces = t->surface_bounces[cell.number];
    r->bottom_bounces = t->bottom_bounces[cell.number];
    r->horizontal_range = distance;
    r->travel_time = time == NULL ? interpolated : *time;
    r->range_by_time = 1.0 / by_range;
    r->range_by_source_depth = -by_source / by_range;
    r->range_by_receiver_depth = -by_receiver / by_range;
    r->range_by_scale = interpolated / by_range;
    r->range_sigma = interpolated * sigma / (1.0 + mean) / by_range;
}

/* Travel time at a horizontal range. The bearing, clockwise from north, matters for tables with several sectors. */
static inline void mantaray_travel_time(
    const mantaray_table *t, double source_depth, double receiver_depth, double horizontal_range, double bearing,
    mantaray_result *result) {
    double place[3] = {source_depth, receiver_depth, horizontal_range};
    mantaray_look_up(t, mantaray_sector(t, bearing), place, NULL, result);
}

#define MANTARAY_GUESSES 7

/* Horizontal range at a travel time and a difference of depth with one of the mean slownesses to begin with. */
static inline double mantaray_first_range(double travel_time, double down, int attempt, double typical) {
    static const double guesses[MANTARAY_GUESSES] = {0.0, 0.006, -0.006, 0.012, -0.012, 0.024, -0.024};
    double straight = travel_time / ((1.0 + guesses[attempt]) * typical);
    double square = straight * straight - down * down;
    return sqrt(square > 0.0 ? square : 0.0);
}

/* Horizontal range at a travel time. */
static inline void mantaray_horizontal_range(
    const mantaray_table *t, double source_depth, double receiver_depth, double travel_time, double bearing,
    mantaray_result *result) {
    double place[3] = {source_depth, receiver_depth, 0.0}, gradient[3];
    double down = receiver_depth - source_depth, range = mantaray_first_range(travel_time, down, 0, t->typical);
    uint32_t sector = mantaray_sector(t, bearing);
    mantaray_cell cell;
    int attempt = 0;
    for (int n = 0; n < 16; n++) { /* Newton's method on the square of time as a function of the square of range */
        place[2] = range < t->lower[2] ? t->lower[2] : range > t->upper[2] ? t->upper[2] : range;
        mantaray_find(t, sector, place, &cell);
        if (cell.number < 0) {
            attempt++;
            if (attempt >= MANTARAY_GUESSES) break;
            range = mantaray_first_range(travel_time, down, attempt, t->typical);
            continue;
        }
        double slowness = (1.0 + mantaray_mean(t, &cell, gradient, NULL)) * MANTARAY_SLOWNESS;
        double inside = place[2], straight = sqrt(inside * inside + down * down);
        double by_range = straight * gradient[2] * MANTARAY_SLOWNESS + slowness * inside / straight;
        double at = straight * slowness;
        double square = inside * inside + (travel_time * travel_time - at * at) * inside / (at * by_range);
        range = sqrt(square > 0.0 ? square : 0.0);
        if (range == inside) break;
    }
    place[2] = range;
    mantaray_look_up(t, sector, place, &travel_time, result);
}

#ifdef __cplusplus
}
#endif

#endif /* MANTARAY_TABLE_H */
