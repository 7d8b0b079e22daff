/*
 * A navigation computer for the rehearsal's bus, in C11.
 *
 * One call of firmware_step is one epoch: intake, fusion, mode (alignment or strapdown), rotation
 * scheme, frames out. All state is struct firmware; there is no clock, I/O or allocation in a step.
 *
 * Frames: n is east-north-up, b right-forward-up, s the sensors' (docs/conventions.md). Angles in rad
 * unless a name says _deg, increments per epoch.
 */
#ifndef FIRMWARE_H
#define FIRMWARE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "rrins_bus.h"

#define PROGRAM "own_firmware"

enum { GROUPS = 16, POSITIONS = 64, INNER = 0, OUTER = 1, AXES = 2, OUTBOX = 16 };

enum height_channel { HEIGHT_HELD, HEIGHT_DAMPED, HEIGHT_FREE };

/* What the computer is set up with, by setup_read. */
struct sensors {
    int count;
    double H[GROUPS][3]; /* input axes in s */
    double weight[GROUPS];
};

struct position {
    int axis;
    double turn_deg;
};

struct setup {
    int64_t rate_hz;
    double latitude, longitude, height; /* rad, rad, m */
    double C_b_n[3][3];                 /* initial attitude, unless self-aligned */
    bool self_aligned;
    bool altimeter;
    enum height_channel height_channel;
    double alignment_s, bridge_s, axis_silence_s;
    double axis_acceleration_dps2, axis_rise_s, follow_tolerance_deg;
    double turn_rate_dps, stand_s;
    int positions;
    struct position position[POSITIONS];
    struct sensors gyros, accelerometers;
};

/* Read a set-up file (docs/own-firmware.md); false with one line in `reason`. */
bool setup_read(struct setup *setup, const char *path, char *reason, size_t size);

/* Keep parameters in a file: this computer has none, and refuses with a reason. */
bool firmware_remember(const char *path, char *reason, size_t size);

/* ---- the clock: the arrival of SYNC by the computer's own clock */

struct clock {
    bool synchronised, lost, seen;
    bool began_late;        /* the first SYNC was of an epoch after the hardware's first second */
    int64_t missed;         /* epochs since the last SYNC */
    int64_t next_ns;        /* when the next SYNC is expected */
    int64_t period_q16;     /* learned, ns * 2^16 */
    int64_t fraction_q16;   /* of next_ns */
    int64_t outliers, jumps;
    int64_t far_epoch;      /* that SYNC has named far from the count, plus 1; 0: none */
};

void clock_power_on(struct clock *clock, int64_t period_ns);
void clock_synchronise(struct clock *clock, int64_t arrival_ns, int64_t epochs_late);
void clock_advance(struct clock *clock);
double clock_error_ppm(const struct clock *clock, int64_t period_ns);

/* ---- end-to-end protection */

bool e2e_is_intact(const struct rrins_frame *frame, uint16_t data_id);
unsigned e2e_counter(const struct rrins_frame *frame);
void e2e_protect(struct rrins_frame *frame, uint16_t data_id, uint64_t counter);

enum { E2E_MODULUS = 15 };

/* ---- what the frames of an epoch brought */

struct heard {
    bool once, disputed;
    uint8_t data[8];
};

struct axis {
    double angle_deg, rate_dps;
    unsigned state;
    int64_t silent_epochs;
    struct heard heard;
    double angle_before_deg, rate_before_dps;
    unsigned state_before;
};

struct intake {
    double gyro[GROUPS], accelerometer[GROUPS]; /* rad, m/s, along the input axes */
    unsigned gyro_valid, accelerometer_valid;   /* one bit each */
    struct heard group[GROUPS], altitude;
    double height; /* m, of the altimeter */
};

struct counters {
    int64_t crc_errors, counter_errors, missing_frames, bridged_epochs, overruns;
    int64_t consecutive_bridged;
};

/* ---- fusion: weighted least squares over the valid sensors */

struct fusion {
    unsigned used; /* sensors that the gain is for */
    bool solvable;
    double gain[3][GROUPS];
};

bool fuse(struct fusion *fusion, const struct sensors *sensors, unsigned valid,
          const double *measured, double *out);

/* ---- vectors, rotations, the Earth */

void cross(double *out, const double *a, const double *b);
void matrix_of_euler(double C[3][3], double roll, double pitch, double heading);
void euler_of_matrix(double C[3][3], double *roll, double *pitch, double *heading);
void gimbal_matrix(double C[3][3], double inner, double outer);
void matrix_of_quaternion(double C[3][3], const double *q);
void quaternion_of_matrix(double *q, double C[3][3]);
void quaternion_of_vector(double *q, const double *phi);
void quaternion_multiply(double *out, const double *p, const double *q);
void quaternion_normalise(double *q);
double earth_gravity(double latitude, double height);
void earth_radii(double latitude, double *meridian, double *prime_vertical);

extern const double EARTH_RATE, EARTH_SEMI_MAJOR_AXIS, EARTH_GRAVITY_EQUATOR, PI;

/* ---- alignment */

struct alignment {
    int64_t epochs;
    double dtheta[3], dv[3];               /* summed */
    double angle_sum[3], angle_moment[3];
    double C_s_n[3][3];
};

void alignment_begin(struct alignment *alignment);
void alignment_add(struct alignment *alignment, const double *dtheta, const double *dv);
void alignment_given(struct alignment *alignment, double C_b_n[3][3], double C_s_b[3][3]);
bool alignment_find(struct alignment *alignment, double dt, double gravity);
void alignment_apply_held_back(struct alignment *alignment, double resolution);

/* ---- strapdown */

struct ins {
    bool first;
    double latitude, longitude, height;
    double latitude_carry, longitude_carry;
    double reference_height, reference_interval, height_error_integral;
    double velocity[3], velocity_change[3];
    double q_s_n[4], C_s_n[3][3];
    double dtheta_previous[3], dv_previous[3];
};

void ins_begin(struct ins *ins, double C_s_n[3][3], const struct setup *setup);
void ins_update(struct ins *ins, const double *dtheta, const double *dv, double dt,
                enum height_channel channel);
bool ins_is_plausible(const struct ins *ins);

/* ---- the rotation scheme */

struct scheme {
    bool running, homing, interrupted;
    int position;
    int64_t cycle, epochs, turn_begun, wait_epochs;
    int tries;
    double start_deg[AXES], target_deg[AXES];
    unsigned command[AXES];
    bool not_following[AXES];
};

struct firmware;
void scheme_start(struct firmware *firmware);
void scheme_stop(struct scheme *scheme, unsigned command);
void scheme_advance(struct firmware *firmware);
bool scheme_watch(struct firmware *firmware);
void scheme_interrupt(struct firmware *firmware);
bool scheme_wait(struct firmware *firmware);
void scheme_resume(struct firmware *firmware);

/* ---- all of it */

struct firmware {
    struct setup setup;
    int64_t period_ns;
    int64_t epoch, steps; /* epoch is -1 before the first SYNC */
    bool is_whole;        /* the frames of a step are one epoch's: in lockstep */
    int64_t sync_arrival_ns;
    double load_percent;
    struct clock clock;
    struct intake intake;
    struct axis axis[AXES];
    struct counters faults;
    struct fusion gyro_fusion, accelerometer_fusion;
    double dtheta[3], dv[3];
    double C_s_b[3][3];
    struct alignment alignment;
    bool aligned;
    struct ins ins;
    int64_t altimeter_epochs;
    struct scheme scheme;
    unsigned mode, fault, pending;
    unsigned request, heard_request;
    unsigned command_counter; /* of the last MODE_COMMAND, plus 1; 0: none */
    int64_t mode_epochs, good_epochs;
    uint64_t transmissions, navigation_transmissions, heartbeats;
};

void firmware_power_on(struct firmware *firmware, const struct setup *setup);

/*
 * Run one epoch on `count` frames; write at most OUTBOX frames to `outbox` and return their number.
 *
 * `consumed` becomes the index of the first frame of a later epoch, for the next step.
 */
size_t firmware_step(struct firmware *firmware, const struct rrins_frame *inbox, size_t count,
                     size_t *consumed, struct rrins_frame *outbox);
bool firmware_is_shut_down(const struct firmware *firmware);
bool firmware_navigates(const struct firmware *firmware);

size_t intake_receive(struct firmware *firmware, const struct rrins_frame *inbox, size_t count);
void intake_close(struct firmware *firmware);
size_t transmit(struct firmware *firmware, struct rrins_frame *outbox);
void heartbeat(struct firmware *firmware, struct rrins_frame *frame);

#endif
