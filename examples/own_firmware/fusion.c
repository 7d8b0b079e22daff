/* Redundant sensors to one vector: weighted least squares. Paper, (54). */
#include "firmware.h"

#include <math.h>
#include <string.h>

static const double CONDITION_LIMIT = 300.0;

/* Write the inverse of a symmetric matrix; return its determinant, not above 0 if it has none. */
static double invert(double out[3][3], double N[3][3])
{
    double determinant;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            int a = (j + 1) % 3, b = (j + 2) % 3, c = (i + 1) % 3, d = (i + 2) % 3;
            out[i][j] = N[a][c] * N[b][d] - N[a][d] * N[b][c];
        }
    determinant = N[0][0] * out[0][0] + N[0][1] * out[1][0] + N[0][2] * out[2][0];
    if (determinant > 0.0)
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                out[i][j] /= determinant;
    return determinant;
}

static double trace(double A[3][3])
{
    return A[0][0] + A[1][1] + A[2][2];
}

/* Write H^T W H of the sensors in `used`. */
static void normal_matrix(double N[3][3], const struct sensors *sensors, unsigned used,
                          bool is_weighted)
{
    memset(N, 0, 9 * sizeof(double));
    for (int k = 0; k < sensors->count; k++)
        if (used >> k & 1u)
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++)
                    N[i][j] += (is_weighted ? sensors->weight[k] : 1.0) * sensors->H[k][i] *
                               sensors->H[k][j];
}

static void prepare(struct fusion *fusion, const struct sensors *sensors, unsigned used)
{
    double N[3][3], inverse[3][3];
    memset(fusion, 0, sizeof *fusion);
    fusion->used = used;
    normal_matrix(N, sensors, used, false);
    if (!(invert(inverse, N) > 0.0) || !(sqrt(trace(N) * trace(inverse)) <= CONDITION_LIMIT))
        return; /* the axes do not span space */
    normal_matrix(N, sensors, used, true);
    fusion->solvable = invert(inverse, N) > 0.0;
    for (int k = 0; k < sensors->count; k++)
        if (used >> k & 1u)
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++)
                    fusion->gain[i][k] += inverse[i][j] * sensors->H[k][j] * sensors->weight[k];
}

bool fuse(struct fusion *fusion, const struct sensors *sensors, unsigned valid,
          const double *measured, double *out)
{
    if (valid != fusion->used)
        prepare(fusion, sensors, valid);
    if (!fusion->solvable)
        return false;
    for (int i = 0; i < 3; i++) {
        out[i] = 0.0;
        for (int k = 0; k < sensors->count; k++)
            out[i] += fusion->gain[i][k] * measured[k];
    }
    return true;
}
