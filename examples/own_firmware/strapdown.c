/* Strapdown navigation in east-north-up on WGS-84 (docs/firmware.md, "Strapdown"). */
#include "firmware.h"

#include <math.h>
#include <string.h>

static const double DAMPING_TIME = 100.0;    /* s, the triple pole of the damped height channel */
static const double LONGEST_INTERVAL = 1.0;  /* s, weight of a reference after a gap */
static const double LARGEST_SPEED = 3000.0;  /* m/s */
static const double LARGEST_LATITUDE_DEG = 89.99;

void ins_begin(struct ins *ins, double C_s_n[3][3], const struct setup *setup)
{
    memset(ins, 0, sizeof *ins);
    quaternion_of_matrix(ins->q_s_n, C_s_n);
    matrix_of_quaternion(ins->C_s_n, ins->q_s_n);
    ins->latitude = setup->latitude;
    ins->longitude = setup->longitude;
    ins->height = ins->reference_height = setup->height;
    ins->first = true;
}

/* Savage (1998), part 2: rotation to second order, sculling with the previous increment */
static void velocity_in_start_frame(const struct ins *ins, double *out, const double *dtheta,
                                    const double *dv)
{
    double once[3], twice[3];
    cross(once, dtheta, dv);
    cross(twice, dtheta, once);
    for (int i = 0; i < 3; i++)
        out[i] = dv[i] + once[i] / 2.0 + twice[i] / 6.0;
    cross(once, ins->dtheta_previous, dv);
    cross(twice, ins->dv_previous, dtheta);
    for (int i = 0; i < 3; i++)
        out[i] += (once[i] + twice[i]) / 12.0;
}

/* Add to an angle, carrying what rounding loses (Kahan): an epoch moves less than a float's step. */
static double added(double angle, double step, double *carry)
{
    double sum;
    step += *carry;
    sum = angle + step;
    *carry = step - (sum - angle);
    return sum;
}

static double wrapped(double longitude)
{
    if (longitude >= PI)
        return longitude - 2.0 * PI;
    return longitude < -PI ? longitude + 2.0 * PI : longitude;
}

/* Siouris, section 5.4 */
static void damp(struct ins *ins)
{
    double dt = fmin(ins->reference_interval, LONGEST_INTERVAL);
    double error = ins->height - ins->reference_height;
    double stiffness = 3.0 / (DAMPING_TIME * DAMPING_TIME) +
                       2.0 * EARTH_GRAVITY_EQUATOR / EARTH_SEMI_MAJOR_AXIS;
    if (dt == 0.0)
        return;
    ins->height_error_integral += error * dt;
    ins->height -= 3.0 / DAMPING_TIME * error * dt;
    ins->velocity[2] -= (stiffness * error + ins->height_error_integral /
                                                 (DAMPING_TIME * DAMPING_TIME * DAMPING_TIME)) *
                        dt;
}

static void turn(struct ins *ins, const double *dtheta, const double *zeta)
{
    double phi[3], back[3], rotation[4], product[4];
    cross(phi, ins->dtheta_previous, dtheta); /* coning: Savage (1998), part 1 */
    for (int i = 0; i < 3; i++) {
        phi[i] = dtheta[i] + phi[i] / 12.0;
        back[i] = -zeta[i];
    }
    quaternion_of_vector(rotation, phi);
    quaternion_multiply(product, ins->q_s_n, rotation);
    quaternion_of_vector(rotation, back);
    quaternion_multiply(ins->q_s_n, rotation, product);
    quaternion_normalise(ins->q_s_n);
    matrix_of_quaternion(ins->C_s_n, ins->q_s_n);
}

void ins_update(struct ins *ins, const double *dtheta, const double *dv, double dt,
                enum height_channel channel)
{
    double M, N, sine = sin(ins->latitude), cosine = cos(ins->latitude);
    double omega_ie[3] = {0.0, EARTH_RATE * cosine, EARTH_RATE * sine};
    double omega_en[3], zeta[3], coriolis[3], middle[3], start[3], dv_n[3], a[3], b[3];
    double north, east, dlatitude;
    if (ins->first) { /* no previous increment: the first, exact for a constant rate */
        ins->first = false;
        memcpy(ins->dtheta_previous, dtheta, sizeof ins->dtheta_previous);
        memcpy(ins->dv_previous, dv, sizeof ins->dv_previous);
    }
    earth_radii(ins->latitude, &M, &N);
    for (int i = 0; i < 3; i++)
        middle[i] = ins->velocity[i] + 0.5 * ins->velocity_change[i];
    omega_en[0] = -middle[1] / (M + ins->height);
    omega_en[1] = middle[0] / (N + ins->height);
    omega_en[2] = omega_en[1] * sine / cosine;
    for (int i = 0; i < 3; i++) {
        zeta[i] = (omega_ie[i] + omega_en[i]) * dt;
        coriolis[i] = 2.0 * omega_ie[i] + omega_en[i];
    }

    /* Velocity: Titterton and Weston (3.25) */
    velocity_in_start_frame(ins, start, dtheta, dv);
    for (int i = 0; i < 3; i++)
        dv_n[i] = ins->C_s_n[i][0] * start[0] + ins->C_s_n[i][1] * start[1] +
                  ins->C_s_n[i][2] * start[2];
    cross(a, zeta, dv_n);
    cross(b, coriolis, middle);
    for (int i = 0; i < 3; i++)
        ins->velocity_change[i] = dv_n[i] - 0.5 * a[i] - b[i] * dt;
    ins->velocity_change[2] -= earth_gravity(ins->latitude, ins->height) * dt;
    if (channel == HEIGHT_HELD)
        ins->velocity_change[2] = 0.0;

    /* Position: trapezoid of the velocity */
    north = 2.0 * ins->velocity[1] + ins->velocity_change[1];
    east = 2.0 * ins->velocity[0] + ins->velocity_change[0];
    dlatitude = 0.5 * dt * north / (M + ins->height);
    cosine -= sine * 0.5 * dlatitude;
    ins->longitude = wrapped(added(ins->longitude,
                                   0.5 * dt * east / ((N + ins->height) * cosine),
                                   &ins->longitude_carry));
    ins->latitude = added(ins->latitude, dlatitude, &ins->latitude_carry);
    ins->height += 0.5 * dt * (2.0 * ins->velocity[2] + ins->velocity_change[2]);
    for (int i = 0; i < 3; i++)
        ins->velocity[i] += ins->velocity_change[i];
    if (channel == HEIGHT_HELD) {
        ins->velocity[2] = 0.0;
        ins->height = ins->reference_height;
    } else if (channel == HEIGHT_DAMPED) {
        damp(ins);
    }
    turn(ins, dtheta, zeta);
    memcpy(ins->dtheta_previous, dtheta, sizeof ins->dtheta_previous);
    memcpy(ins->dv_previous, dv, sizeof ins->dv_previous);
}

bool ins_is_plausible(const struct ins *ins)
{
    const double *v = ins->velocity;
    double speed = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    return speed < LARGEST_SPEED && fabs(ins->latitude) < LARGEST_LATITUDE_DEG * PI / 180.0;
}
