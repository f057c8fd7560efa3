/*
 * Look up places from standard input in a table, and print all results as the bits of doubles; see test_c_reader.py.
 *
 *     read_table TABLE 0            results of all places
 *     read_table TABLE N            seconds of one look-up, the mean of N
 *     read_table TABLE fuzz N       look-ups in N damaged copies of the table, without input
 */
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "mantaray_table.h"

static void print(double x) {
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    printf(" %llu", (unsigned long long)bits);
}

static uint64_t noise = 88172645463325252u; /* xorshift of Marsaglia */

static uint64_t below(uint64_t limit) {
    noise ^= noise << 13;
    noise ^= noise >> 7;
    noise ^= noise << 17;
    return noise % limit;
}

/* A number of any size, infinite or NaN, or one within limits. */
static double wild(double low, double high) {
    static const double odd[] = {0.0, -1.0, 1e308, -1e308, 1e-308, INFINITY, -INFINITY, NAN};
    uint64_t which = below(16);
    return which < 8 ? odd[which] : low + (high - low) * (double)below(1000000) / 1e6;
}

/* Open and use damaged copies, each in a block of its own size, so that a sanitizer sees every access outside. */
static int fuzz(const unsigned char *bytes, size_t size, long number) {
    long opened = 0;
    double sum = 0.0;
    for (long n = 0; n < number; n++) {
        size_t length = below(8) ? size : (size_t)below(size);
        unsigned char *copy = malloc(length ? length : 1);
        memcpy(copy, bytes, length);
        for (uint64_t change = below(6); length && change < 6; change++) {
            size_t end = below(2) && length > 88 ? 88 : length; /* the header, or any byte */
            copy[below(end)] = (unsigned char)below(256);
        }
        if (length > 4 && below(4)) { /* most copies have the checksum of their damage, so that other checks are reached */
            uint32_t crc = mantaray_crc32(copy, length - 4);
            for (int k = 0; k < 4; k++) copy[length - 4 + k] = (unsigned char)(crc >> 8 * k);
        }
        mantaray_table table;
        if (mantaray_table_open(&table, copy, length) == MANTARAY_OK) {
            mantaray_result r;
            opened++;
            for (int k = 0; k < 8; k++) {
                double a = wild(table.lower[0], table.upper[0]), b = wild(table.lower[1], table.upper[1]);
                double c = wild(table.lower[2], table.upper[2]), bearing = wild(-7.0, 7.0);
                mantaray_travel_time(&table, a, b, c, bearing, &r);
                sum += mantaray_has_range(r.status) ? r.travel_time : 0.0;
                mantaray_horizontal_range(&table, a, b, c / 1500.0, bearing, &r);
                sum += mantaray_has_range(r.status) ? r.horizontal_range : 0.0;
            }
        }
        free(copy);
    }
    printf("%ld %ld %g\n", opened, number, sum);
    return 0;
}

int main(int argc, char **argv) {
    FILE *file = argc > 2 ? fopen(argv[1], "rb") : NULL;
    if (file == NULL) return 2;
    fseek(file, 0, SEEK_END);
    size_t size = (size_t)ftell(file);
    unsigned char *bytes = malloc(size ? size : 1);
    rewind(file);
    if (fread(bytes, 1, size, file) != size) return 2;
    fclose(file);
    if (argc > 3) {
        int done = fuzz(bytes, size, atol(argv[3]));
        free(bytes);
        return done;
    }
    mantaray_table table;
    int error = mantaray_table_open(&table, bytes, size);
    if (error) {
        free(bytes);
        return 10 + error;
    }
    double source, receiver, third, bearing;
    mantaray_result r;
    double sum = 0.0;
    long repeats = atol(argv[2]), count = 0;
    double (*places)[4] = malloc(sizeof(double[4]) * 200000);
    while (count < 200000 && scanf("%lf %lf %lf %lf", &source, &receiver, &third, &bearing) == 4) {
        places[count][0] = source, places[count][1] = receiver, places[count][2] = third, places[count][3] = bearing;
        count++;
    }
    for (long i = 0; i < count && !repeats; i++) {
        for (int inverse = 0; inverse < 2; inverse++) {
            double x = inverse ? places[i][2] / 1500.0 : places[i][2];
            (inverse ? mantaray_horizontal_range : mantaray_travel_time)(
                &table, places[i][0], places[i][1], x, places[i][3], &r);
            printf("%d %d %d", r.status, r.surface_bounces, r.bottom_bounces);
            print(r.horizontal_range), print(r.travel_time), print(r.range_by_time);
            print(r.range_by_source_depth), print(r.range_by_receiver_depth), print(r.range_by_scale);
            print(r.range_sigma);
            printf("\n");
        }
    }
    if (repeats) {
        clock_t begin = clock();
        for (long n = 0; n < repeats; n++) {
            const double *p = places[n % count];
            mantaray_horizontal_range(&table, p[0], p[1], p[2] / 1500.0, p[3], &r);
            sum += r.status;
        }
        printf("%.9f %g\n", (double)(clock() - begin) / CLOCKS_PER_SEC / (double)repeats, sum);
    }
    free(places);
    free(bytes);
    return 0;
}
