/* Look up places from standard input in a table, and print all results as the bits of doubles; see test_c_reader.py. */
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "mantaray_table.h"

static void print(double x) {
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    printf(" %llu", (unsigned long long)bits);
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
