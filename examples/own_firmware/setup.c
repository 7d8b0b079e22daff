/* The set-up file: a key and its values on each line (docs/own-firmware.md). */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware.h"

enum { WORDS = 4, LINE = 256, VERSION = 1 };

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

static double radians(double degrees)
{
    return degrees * PI / 180.0;
}

static bool is(const struct line *line, const char *word)
{
    return line->words > 0 && strcmp(line->word[0], word) == 0;
}

/* A sensor: polar angle from z, azimuth from x (deg), weight. Paper, (5) */
static bool add_sensor(struct sensors *sensors, const struct line *line)
{
    double polar = radians(number(line, 0)), azimuth = radians(number(line, 1));
    double *h = sensors->H[sensors->count < GROUPS ? sensors->count : 0];
    if (sensors->count == GROUPS || line->words != 3)
        return false;
    h[0] = sin(polar) * cos(azimuth);
    h[1] = sin(polar) * sin(azimuth);
    h[2] = cos(polar);
    sensors->weight[sensors->count++] = number(line, 2);
    return true;
}

static bool add_turn(struct setup *setup, const struct line *line)
{
    struct position *position;
    if (setup->positions == POSITIONS || line->words != 2)
        return false;
    position = &setup->position[setup->positions++];
    position->axis = is(line, "outer") ? OUTER : INNER;
    position->turn_deg = number(line, 1);
    return true;
}

/* The place of a number in the set-up; NULL for a key that is none. */
static double *place(struct setup *setup, double *angles, const char *key)
{
    const struct {
        const char *key;
        double *place;
    } table[] = {
        {"latitude_deg", &setup->latitude},
        {"longitude_deg", &setup->longitude},
        {"height_m", &setup->height},
        {"roll_deg", &angles[0]},
        {"pitch_deg", &angles[1]},
        {"heading_deg", &angles[2]},
        {"alignment_s", &setup->alignment_s},
        {"bridge_s", &setup->bridge_s},
        {"axis_silence_s", &setup->axis_silence_s},
        {"axis_acceleration_dps2", &setup->axis_acceleration_dps2},
        {"axis_rise_s", &setup->axis_rise_s},
        {"follow_tolerance_deg", &setup->follow_tolerance_deg},
        {"turn_rate_dps", &setup->turn_rate_dps},
        {"stand_s", &setup->stand_s},
    };
    for (size_t k = 0; k < sizeof table / sizeof *table; k++)
        if (strcmp(table[k].key, key) == 0)
            return table[k].place;
    return NULL;
}

/* Take a line; a key that this computer does not know is for others. */
static bool take(struct setup *setup, double *angles, const struct line *line)
{
    double *where = place(setup, angles, line->key);
    if (where != NULL) {
        *where = number(line, 0);
        return line->words == 1 && isfinite(*where);
    }
    if (strcmp(line->key, "rate_hz") == 0)
        setup->rate_hz = strtoll(line->words > 0 ? line->word[0] : "", NULL, 10);
    else if (strcmp(line->key, "initial_attitude") == 0)
        setup->self_aligned = is(line, "self-aligned");
    else if (strcmp(line->key, "altimeter") == 0)
        setup->altimeter = is(line, "1");
    else if (strcmp(line->key, "height_channel") == 0)
        setup->height_channel = is(line, "held")     ? HEIGHT_HELD
                                : is(line, "damped") ? HEIGHT_DAMPED
                                                     : HEIGHT_FREE;
    else if (strcmp(line->key, "gyro") == 0)
        return add_sensor(&setup->gyros, line);
    else if (strcmp(line->key, "accelerometer") == 0)
        return add_sensor(&setup->accelerometers, line);
    else if (strcmp(line->key, "turn") == 0)
        return add_turn(setup, line);
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

static bool is_whole(const struct setup *setup)
{
    return setup->rate_hz > 0 && setup->positions > 0 && setup->gyros.count >= 3 &&
           setup->accelerometers.count >= 3 && setup->turn_rate_dps > 0 &&
           setup->axis_acceleration_dps2 > 0;
}

static bool read_lines(struct setup *setup, FILE *file, char *reason, size_t size)
{
    char text[LINE];
    double angles[3] = {0.0, 0.0, 0.0};
    for (int number_of_line = 1; fgets(text, sizeof text, file) != NULL; number_of_line++) {
        struct line line = split(text);
        if (line.key == NULL)
            continue;
        if (number_of_line == 1) {
            if (strcmp(line.key, "rrins-setup") != 0 || number(&line, 0) != VERSION) {
                snprintf(reason, size, "not a set-up of version %d", VERSION);
                return false;
            }
        } else if (!take(setup, angles, &line)) {
            snprintf(reason, size, "line %d: %s: not as it should be", number_of_line, line.key);
            return false;
        }
    }
    setup->latitude = radians(setup->latitude);
    setup->longitude = radians(setup->longitude);
    matrix_of_euler(setup->C_b_n, radians(angles[0]), radians(angles[1]), radians(angles[2]));
    if (!is_whole(setup))
        snprintf(reason, size, "not a whole set-up");
    return is_whole(setup);
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
