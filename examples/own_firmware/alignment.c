/* Initial attitude: given, or found at standstill (TRIAD; Groves, 5.6.1 and 5.6.2). */
#include "firmware.h"

#include <math.h>
#include <string.h>

static const double FORCE_TOLERANCE = 0.02;     /* of gravity */
static const double SMALLEST_HORIZONTAL = 1e-3; /* of the Earth's rate */

void alignment_begin(struct alignment *alignment)
{
    memset(alignment, 0, sizeof *alignment);
}

void alignment_add(struct alignment *alignment, const double *dtheta, const double *dv)
{
    alignment->epochs++;
    for (int i = 0; i < 3; i++) {
        alignment->dtheta[i] += dtheta[i];
        alignment->dv[i] += dv[i];
        alignment->angle_sum[i] += alignment->dtheta[i];
        alignment->angle_moment[i] += (double)alignment->epochs * alignment->dtheta[i];
    }
}

void alignment_given(struct alignment *alignment, double C_b_n[3][3], double C_s_b[3][3])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            alignment->C_s_n[i][j] = C_b_n[i][0] * C_s_b[0][j] + C_b_n[i][1] * C_s_b[1][j] +
                                     C_b_n[i][2] * C_s_b[2][j];
}

static double normalise(double *v)
{
    double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    if (length > 0.0)
        for (int i = 0; i < 3; i++)
            v[i] /= length;
    return length;
}

bool alignment_find(struct alignment *alignment, double dt, double gravity)
{
    double seconds = (double)alignment->epochs * dt, length;
    double *east = alignment->C_s_n[0], *north = alignment->C_s_n[1], *up = alignment->C_s_n[2];
    memcpy(up, alignment->dv, sizeof alignment->dv);
    length = normalise(up);
    if (!(fabs(length - gravity * seconds) < FORCE_TOLERANCE * gravity * seconds))
        return false;
    cross(east, alignment->dtheta, up);
    if (!(normalise(east) > SMALLEST_HORIZONTAL * EARTH_RATE * seconds))
        return false;
    cross(north, up, east);
    return true;
}

/* Counted angles scatter about the true ones: start on the line through their scatter. */
void alignment_apply_held_back(struct alignment *alignment, double resolution)
{
    double n = (double)alignment->epochs, held_back[3], turned[3];
    if (alignment->epochs < 3)
        return;
    for (int i = 0; i < 3; i++) {
        double mean = alignment->angle_sum[i] / n;
        double slope = (alignment->angle_moment[i] - mean * n * (n + 1.0) / 2.0) /
                       (n * (n * n - 1.0) / 12.0);
        double difference = alignment->dtheta[i] - (mean + slope * (n - 1.0) / 2.0);
        held_back[i] = fmin(resolution, fmax(-resolution, difference));
    }
    for (int i = 0; i < 3; i++) {
        cross(turned, alignment->C_s_n[i], held_back);
        for (int j = 0; j < 3; j++)
            alignment->C_s_n[i][j] += turned[j];
    }
}
