/* A line on a half-space in full contact, p_q = E* q h_q / 2, by direct Fourier sums:
   reads a scene of epcontact and writes its result.  cc full_contact.c -lm && ./a.out SCENE RESULT */
#include <math.h>
#include <stdio.h>
#include <string.h>
int main(int argc, char **argv) {
    FILE *scene = fopen(argv[1], "r"), *result = fopen(argv[2], "w");
    char name[64];
    double E = 1, nu = 0, L = 1, load = 0, h[4096], x;
    int n = 0, full = 1;
    if (argc < 3 || !scene || !result) return 3;
    while (fscanf(scene, "%63s", name) == 1 && strcmp(name, "heights")) {
        if (!strcmp(name, "shape")) fscanf(scene, "%d", &n);
        if (!strcmp(name, "periods")) fscanf(scene, "%lf", &L);
        if (!strcmp(name, "young_modulus")) fscanf(scene, "%lf", &E);
        if (!strcmp(name, "poisson_ratio")) fscanf(scene, "%lf", &nu);
        if (!strcmp(name, "loads")) for (fscanf(scene, "%d", &full); full > 0; full--) fscanf(scene, "%lf", &load);
    }
    for (int i = 0; i < n; i++) fscanf(scene, "%lf", &h[i]);
    fprintf(result, "epcontact-result 1\npressure\n");
    for (int i = full = 0; i < n; i++, full += x > 0) {
        x = load;
        for (int m = 1; m <= n / 2; m++)
            for (int j = 0; j < n; j++)
                x += E / (1 - nu * nu) * M_PI * m / L * h[j] * cos(2 * M_PI * m * (i - j) / n) * (m < n - m ? 2. : 1.) / n;
        fprintf(result, "%.17g\n", x);
    }
    fprintf(result, "converged %d\n", full == n);
    return 0;
}
