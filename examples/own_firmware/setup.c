/* The set-up file: a key and its values on each line (docs/own-firmware.md). */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware.h"

enum { WORDS = 4, LINE = 256, VERSION = 1 };

/* Keys that have one value, a number or one of these words, and stand in every set-up. */
enum key {
    RATE, LATITUDE, LONGITUDE, HEIGHT, ROLL, PITCH, HEADING, ATTITUDE, ALIGNMENT, CHANNEL,
    ALTIMETER, BRIDGE, TURN_RATE, STAND, ACCELERATION, RISE, TOLERANCE, SILENCE, KEYS
};

static const struct {
    const char *name, *word[3];
} KEY[KEYS] = {
    [RATE] = {"rate_hz", {0}},
    [LATITUDE] = {"latitude_deg", {0}},
    [LONGITUDE] = {"longitude_deg", {0}},
    [HEIGHT] = {"height_m", {0}},
    [ROLL] = {"roll_deg", {0}},
    [PITCH] = {"pitch_deg", {0}},
    [HEADING] = {"heading_deg", {0}},
    [ATTITUDE] = {"initial_attitude", {"given", "self-aligned"}},
    [ALIGNMENT] = {"alignment_s", {0}},
    [CHANNEL] = {"height_channel", {"held", "damped", "free"}}, /* as enum height_channel */
    [ALTIMETER] = {"altimeter", {0}},
    [BRIDGE] = {"bridge_s", {0}},
    [TURN_RATE] = {"turn_rate_dps", {0}},
    [STAND] = {"stand_s", {0}},
    [ACCELERATION] = {"axis_acceleration_dps2", {0}},
    [RISE] = {"axis_rise_s", {0}},
    [TOLERANCE] = {"follow_tolerance_deg", {0}},
    [SILENCE] = {"axis_silence_s", {0}},
};

static const char *const AXIS[3] = {"inner", "outer"};

struct line {
    const char *key;
    char *word[WORDS];
    int words;
};

static double number(const struct line *line, int k)
{
    char *end;
    double value;
    if (k >= line->words)
        return NAN;
    value = strtod(line->word[k], &end);
    return *end == '\0' ? value : NAN;
}

/* Which of up to three words comes first in a line. */
static double which(const struct line *line, const char *const *words)
{
    for (int k = 0; k < 3 && words[k] != NULL && line->words > 0; k++)
        if (strcmp(line->word[0], words[k]) == 0)
            return k;
    return NAN;
}

static double radians(double degrees)
{
    return degrees * PI / 180.0;
}

/* A sensor: polar angle from z, azimuth from x (deg), weight. Paper, (5) */
static bool add_sensor(struct sensors *sensors, const struct line *line)
{
    double polar = radians(number(line, 0)), azimuth = radians(number(line, 1));
    double weight = number(line, 2), *h = sensors->H[sensors->count];
    if (sensors->count == GROUPS || line->words != 3 || !isfinite(polar + azimuth + weight))
        return false;
    h[0] = sin(polar) * cos(azimuth);
    h[1] = sin(polar) * sin(azimuth);
    h[2] = cos(polar);
    sensors->weight[sensors->count++] = weight;
    return true;
}

static bool add_turn(struct setup *setup, const struct line *line)
{
    double axis = which(line, AXIS), turn_deg = number(line, 1);
    if (setup->positions == POSITIONS || line->words != 2 || !isfinite(axis + turn_deg))
        return false;
    setup->position[setup->positions++] = (struct position){(int)axis, turn_deg};
    return true;
}

/* Take a line; a key that this computer does not know is for others. */
static bool take(struct setup *setup, double *value, const struct line *line)
{
    if (strcmp(line->key, "gyro") == 0)
        return add_sensor(&setup->gyros, line);
    if (strcmp(line->key, "accelerometer") == 0)
        return add_sensor(&setup->accelerometers, line);
    if (strcmp(line->key, "turn") == 0)
        return add_turn(setup, line);
    for (int k = 0; k < KEYS; k++)
        if (strcmp(KEY[k].name, line->key) == 0) {
            value[k] = KEY[k].word[0] == NULL ? number(line, 0) : which(line, KEY[k].word);
            return line->words == 1 && isfinite(value[k]);
        }
    return true;
}

static struct line split(char *text)
{
    struct line line = {0};
    line.key = strtok(text, " \n");
    while (line.words < WORDS && (line.word[line.words] = strtok(NULL, " \n")) != NULL)
        line.words++;
    return line;
}

/* Put the values where they belong; return the first key without a sensible one, or NULL. */
static const char *finish(struct setup *setup, const double *value)
{
    static const enum key ABOVE_0[] = {TURN_RATE, ACCELERATION};
    for (int k = 0; k < KEYS; k++)
        if (!isfinite(value[k]))
            return KEY[k].name;
    for (size_t k = 0; k < sizeof ABOVE_0 / sizeof *ABOVE_0; k++)
        if (!(value[ABOVE_0[k]] > 0.0))
            return KEY[ABOVE_0[k]].name;
    setup->rate_hz = (int64_t)value[RATE];
    setup->latitude = radians(value[LATITUDE]);
    setup->longitude = radians(value[LONGITUDE]);
    setup->height = value[HEIGHT];
    matrix_of_euler(setup->C_b_n, radians(value[ROLL]), radians(value[PITCH]),
                    radians(value[HEADING]));
    setup->self_aligned = value[ATTITUDE] != 0.0;
    setup->alignment_s = value[ALIGNMENT];
    setup->height_channel = (enum height_channel)value[CHANNEL];
    setup->altimeter = value[ALTIMETER] != 0.0;
    setup->bridge_s = value[BRIDGE];
    setup->turn_rate_dps = value[TURN_RATE];
    setup->stand_s = value[STAND];
    setup->axis_acceleration_dps2 = value[ACCELERATION];
    setup->axis_rise_s = value[RISE];
    setup->follow_tolerance_deg = value[TOLERANCE];
    setup->axis_silence_s = value[SILENCE];
    return setup->rate_hz < 1                ? "rate_hz"
           : setup->gyros.count < 3          ? "gyro"
           : setup->accelerometers.count < 3 ? "accelerometer"
           : setup->positions == 0           ? "turn"
                                             : NULL;
}

static bool read_lines(struct setup *setup, FILE *file, char *reason, size_t size)
{
    char text[LINE];
    const char *wanted;
    double value[KEYS];
    for (int k = 0; k < KEYS; k++)
        value[k] = NAN;
    for (int number_of_line = 1; fgets(text, sizeof text, file) != NULL; number_of_line++) {
        struct line line = split(text);
        if (number_of_line == 1) {
            if (line.key == NULL || strcmp(line.key, "rrins-setup") != 0 ||
                number(&line, 0) != VERSION) {
                snprintf(reason, size, "not a set-up of version %d", VERSION);
                return false;
            }
        } else if (line.key != NULL && !take(setup, value, &line)) {
            snprintf(reason, size, "line %d: %s: not as it should be", number_of_line, line.key);
            return false;
        }
    }
    wanted = finish(setup, value);
    if (wanted != NULL)
        snprintf(reason, size, "%s: missing, or not enough", wanted);
    return wanted == NULL;
}

bool setup_read(struct setup *setup, const char *path, char *reason, size_t size)
{
    FILE *file = path == NULL ? NULL : fopen(path, "r");
    bool is_read;
    if (file == NULL) {
        snprintf(reason, size, path == NULL ? "names the set-up's file" : "cannot be opened");
        return false;
    }
    memset(setup, 0, sizeof *setup);
    is_read = read_lines(setup, file, reason, size);
    fclose(file);
    return is_read;
}

bool firmware_remember(const char *path, char *reason, size_t size)
{
    (void)path;
    snprintf(reason, size, "this computer has no parameter memory");
    return false;
}
