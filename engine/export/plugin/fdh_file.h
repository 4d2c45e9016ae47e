/* A data file of a patch (.fdh), which engine/export/plugin_data.py writes. All instances share it. No function is for the
 * audio thread. */
#ifndef FDH_FILE_H
#define FDH_FILE_H

#include <stdint.h>

#include "fdh_numbers.h" /* numbers of the engine */

typedef struct {
    int64_t number[8], table; /* kind to is_release; place of the copies of an exchange of tables */
    double value[FDH_VALUES];
} fdh_row;
typedef struct {
    int64_t first, count; /* of rows */
} fdh_rows;
typedef struct {
    int64_t number, group; /* keys of one group, if it is not negative, sound one at a time */
    fdh_rows on[FDH_LEVELS], soft_on[FDH_LEVELS], off[FDH_LEVELS], soft_off[FDH_LEVELS], damp[FDH_PEDAL_STEPS], lift,
        steal, choke;
} fdh_key;
enum { FDH_SLIDER, FDH_TABLE, FDH_WHEEL };
typedef struct {
    int64_t kind, is_logarithmic, first, count, first_position, overlapping, number;
    double low, high, home, shift, part, unit, compliance, most; /* the last five: the law of the values of the rows */
} fdh_control;

typedef struct { /* a sample rate, unpacked: what all players of it read */
    int rate, players;
    const int64_t *numbers; /* FDH_RATE_… */
    unsigned char *shared, *private_bytes; /* `shared` is read in its place; of `private_bytes` each player has a copy */
    int64_t shared_size, private_size, pointer_count, row_count;
    const int64_t *pointers;
    const fdh_row *rows;
    const fdh_key *keys;
    const fdh_control *controls;
    const double *positions;
    void *memory;
} fdh_rate;

enum { FDH_MAX_RATES = 8, FDH_MAX_KEYS = 128, FDH_FAULT = 256 };
typedef struct fdh_file {
    struct fdh_file *next;
    int users;
    char path[1024], fault[FDH_FAULT]; /* fault: why it cannot be used; "": it can */
    unsigned char *bytes;
    int64_t size;
    uint32_t id; /* checksum of what is in it */
    int channels, polyphony, keys, controls, rate_count, rates[FDH_MAX_RATES];
    double gain;
    char **texts;
    int64_t levels[FDH_LEVELS], pedal_down, shares[128];
    const fdh_control *about_controls; /* of the first rate: ranges */
    const fdh_key *about_keys;
    fdh_rate at[FDH_MAX_RATES];
} fdh_file;

/* Open a file: what names it is checked, the sample rates are unpacked when they are wanted. One that is open already is
 * the same. NULL: no memory. */
fdh_file *fdh_open(const char *path);
void fdh_close(fdh_file *file);

/* Return a sample rate, to be released; NULL: it cannot be unpacked, and the fault says why. */
const fdh_rate *fdh_take_rate(fdh_file *file, int index);
void fdh_release_rate(fdh_file *file, const fdh_rate *rate);

/* Texts: of the whole file, of its keys, and of its controls. */
enum { FDH_NAME, FDH_TITLE, FDH_AUTHOR, FDH_LICENCE, FDH_VERSION, FDH_TEXTS };
const char *fdh_text(const fdh_file *file, int which);
const char *fdh_key_name(const fdh_file *file, int key);
const char *fdh_control_name(const fdh_file *file, int control);
const char *fdh_control_unit(const fdh_file *file, int control);

/* Unpack raw deflated data (RFC 1951). Returns 0 if it is exactly `size` bytes. */
int fdh_inflate(const unsigned char *from, int64_t count, unsigned char *to, int64_t size);
#endif
