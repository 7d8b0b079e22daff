/* Rotations and the Earth, WGS-84 (NIMA TR8350.2; Groves, 2nd ed.). Quaternions are scalar first. */
#include "firmware.h"

#include <math.h>

const double PI = 3.14159265358979323846;
const double EARTH_RATE = 7.292115e-5;            /* rad/s */
const double EARTH_SEMI_MAJOR_AXIS = 6378137.0;   /* m */
const double EARTH_GRAVITY_EQUATOR = 9.7803253359; /* m/s^2 */
static const double FLATTENING = 1 / 298.257223563;
static const double GRAVITATIONAL_CONSTANT = 3.986004418e14; /* m^3/s^2 */
static const double SOMIGLIANA = 1.931852652458e-3;

static double eccentricity_squared(void)
{
    return FLATTENING * (2 - FLATTENING);
}

/* Groves (2.105), (2.106) */
void earth_radii(double latitude, double *meridian, double *prime_vertical)
{
    double sine = sin(latitude);
    double root = 1.0 - eccentricity_squared() * sine * sine;
    *prime_vertical = EARTH_SEMI_MAJOR_AXIS / sqrt(root);
    *meridian = *prime_vertical * (1.0 - eccentricity_squared()) / root;
}

/* Groves (2.134), (2.139) */
double earth_gravity(double latitude, double height)
{
    double sine = sin(latitude), squared = sine * sine;
    double a = EARTH_SEMI_MAJOR_AXIS, ratio = height / a;
    double m = EARTH_RATE * EARTH_RATE * a * a * a * (1 - FLATTENING) / GRAVITATIONAL_CONSTANT;
    double surface = EARTH_GRAVITY_EQUATOR * (1.0 + SOMIGLIANA * squared) /
                     sqrt(1.0 - eccentricity_squared() * squared);
    double linear = 2.0 * (1.0 + FLATTENING * (1.0 - 2.0 * squared) + m) * ratio;
    return surface * (1.0 - linear + 3.0 * ratio * ratio);
}

void cross(double *out, const double *a, const double *b)
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* C_b_n = Rz(-heading) Rx(pitch) Ry(roll) */
void matrix_of_euler(double C[3][3], double roll, double pitch, double heading)
{
    double cr = cos(roll), sr = sin(roll), cp = cos(pitch), sp = sin(pitch);
    double ch = cos(heading), sh = sin(heading);
    C[0][0] = ch * cr + sh * sp * sr;
    C[0][1] = sh * cp;
    C[0][2] = ch * sr - sh * sp * cr;
    C[1][0] = -sh * cr + ch * sp * sr;
    C[1][1] = ch * cp;
    C[1][2] = -sh * sr - ch * sp * cr;
    C[2][0] = -cp * sr;
    C[2][1] = sp;
    C[2][2] = cp * cr;
}

void euler_of_matrix(double C[3][3], double *roll, double *pitch, double *heading)
{
    *roll = atan2(-C[2][0], C[2][2]);
    *pitch = asin(fmin(1.0, fmax(-1.0, C[2][1])));
    *heading = atan2(C[0][1], C[1][1]);
    if (*heading < 0.0)
        *heading += 2.0 * PI;
    if (*heading >= 2.0 * PI)
        *heading = 0.0;
}

/* C_s_b = Rx(outer) Rz(inner). Paper, (22) */
void gimbal_matrix(double C[3][3], double inner, double outer)
{
    double ci = cos(inner), si = sin(inner), co = cos(outer), so = sin(outer);
    C[0][0] = ci;
    C[0][1] = -si;
    C[0][2] = 0.0;
    C[1][0] = co * si;
    C[1][1] = co * ci;
    C[1][2] = -so;
    C[2][0] = so * si;
    C[2][1] = so * ci;
    C[2][2] = co;
}

void quaternion_normalise(double *q)
{
    double scale = 1.0 / sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    for (int i = 0; i < 4; i++)
        q[i] *= scale;
}

void quaternion_multiply(double *out, const double *p, const double *q)
{
    out[0] = p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3];
    out[1] = p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2];
    out[2] = p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1];
    out[3] = p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0];
}

/* The quaternion of a rotation vector; a series where the angle is small. */
void quaternion_of_vector(double *q, const double *phi)
{
    double squared = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2];
    double quarter = squared / 4.0, angle = sqrt(squared), ratio;
    if (squared < 1e-4) {
        q[0] = 1.0 - quarter / 2.0 * (1.0 - quarter / 12.0);
        ratio = 0.5 * (1.0 - quarter / 6.0 * (1.0 - quarter / 20.0));
    } else {
        q[0] = cos(angle / 2.0);
        ratio = sin(angle / 2.0) / angle;
    }
    for (int i = 0; i < 3; i++)
        q[1 + i] = ratio * phi[i];
}

void matrix_of_quaternion(double C[3][3], const double *q)
{
    double w = q[0], x = q[1], y = q[2], z = q[3];
    C[0][0] = 1.0 - 2.0 * (y * y + z * z);
    C[0][1] = 2.0 * (x * y - w * z);
    C[0][2] = 2.0 * (x * z + w * y);
    C[1][0] = 2.0 * (x * y + w * z);
    C[1][1] = 1.0 - 2.0 * (x * x + z * z);
    C[1][2] = 2.0 * (y * z - w * x);
    C[2][0] = 2.0 * (x * z - w * y);
    C[2][1] = 2.0 * (y * z + w * x);
    C[2][2] = 1.0 - 2.0 * (x * x + y * y);
}

/* Shepperd's method */
void quaternion_of_matrix(double *q, double C[3][3])
{
    double trace = C[0][0] + C[1][1] + C[2][2], largest = trace, scale;
    int k = -1;
    for (int i = 0; i < 3; i++)
        if (C[i][i] > largest) {
            k = i;
            largest = C[i][i];
        }
    if (k < 0) {
        q[0] = sqrt(1.0 + trace) / 2.0;
        scale = 0.25 / q[0];
        q[1] = (C[2][1] - C[1][2]) * scale;
        q[2] = (C[0][2] - C[2][0]) * scale;
        q[3] = (C[1][0] - C[0][1]) * scale;
    } else {
        int i = (k + 1) % 3, j = (k + 2) % 3;
        q[1 + k] = sqrt(1.0 + 2.0 * C[k][k] - trace) / 2.0;
        scale = 0.25 / q[1 + k];
        q[0] = (C[j][i] - C[i][j]) * scale;
        q[1 + i] = (C[i][k] + C[k][i]) * scale;
        q[1 + j] = (C[j][k] + C[k][j]) * scale;
    }
    quaternion_normalise(q);
}
