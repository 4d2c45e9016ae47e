/* What is in a file is checked before it is used: checksums against damage, and each place, count and index that this
 * code or the kernels follow against the part that it lies in. What the kernels compute with is taken as it is. */
#include "fdh_file.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#ifdef _WIN32
#include <windows.h>
#endif

enum { HEAD_WORDS = 16, SECTION_WORDS = 8, FORMAT = 1, NUMBER_COUNT = 6, ALIGNMENT = 64 };
enum { LENGTH = 2, SOURCES, SECTIONS, TABLE_SUM, MAGIC = 0, VERSION }; /* words of the head */
enum { KIND, RATE, PLACE, PACKED, WHOLE, PACKED_SUM, SUM }; /* words of a section */
enum { NUMBERS = 1, TEXTS, LEVELS, OF_RATE, SHARED, PRIVATE, POINTERS, ROWS, KEYS, CONTROLS, POSITIONS };
static const int64_t IS_SHARED = (int64_t)1 << 62;

static int fail(fdh_file *file, const char *format, ...) {
    va_list rest;
    va_start(rest, format);
    vsnprintf(file->fault, FDH_FAULT, format, rest);
    va_end(rest);
    return -1;
}

static uint32_t checksum(const unsigned char *bytes, int64_t size) { /* CRC-32 */
    static uint32_t table[256];
    if (!table[1]) {
        uint32_t made[256]; /* two threads may make it: both write the same, and the entry that says it is there last */
        for (uint32_t n = 0; n < 256; n++) {
            made[n] = n;
            for (int k = 0; k < 8; k++) made[n] = made[n] & 1 ? made[n] >> 1 ^ 0xedb88320u : made[n] >> 1;
        }
        memcpy(table + 2, made + 2, sizeof made - 2 * sizeof *made);
        table[0] = made[0], table[1] = made[1];
    }
    uint32_t sum = 0xffffffffu;
    for (int64_t n = 0; n < size; n++) sum = sum >> 8 ^ table[(sum ^ bytes[n]) & 255];
    return ~sum;
}

static FILE *open_for_reading(const char *path) {
#ifdef _WIN32
    wchar_t wide[1024]; /* hosts name files in UTF-8 */
    return MultiByteToWideChar(CP_UTF8, 0, path, -1, wide, 1024) ? _wfopen(wide, L"rb") : NULL;
#else
    return fopen(path, "rb");
#endif
}

static int read_bytes(fdh_file *file) {
    FILE *from = open_for_reading(file->path);
    if (!from) return fail(file, "%.180s is not there, or cannot be read", file->path);
    long size = fseek(from, 0, SEEK_END) ? -1 : ftell(from);
    int is_read = 0;
    if (size > 0 && (file->bytes = malloc((size_t)size + 8)) != NULL) {
        rewind(from);
        is_read = fread(file->bytes, 1, (size_t)size, from) == (size_t)size;
    }
    fclose(from);
    file->size = size;
    return is_read ? 0 : fail(file, "%.180s cannot be read", file->path);
}

static const int64_t *words_of(const fdh_file *file) { return (const int64_t *)(const void *)file->bytes; }

static const int64_t *find_section(const fdh_file *file, int kind, int rate) {
    const int64_t *section = words_of(file) + HEAD_WORDS;
    for (int64_t n = 0; n < words_of(file)[SECTIONS]; n++, section += SECTION_WORDS)
        if (section[KIND] == kind && section[RATE] == rate) return section;
    return NULL;
}

static int check_head(fdh_file *file) {
    const int64_t *head = words_of(file);
    int64_t size = file->size;
    if (size < 8 * HEAD_WORDS || memcmp(file->bytes, "FDHPLUG", 7)) return fail(file, "%.150s is no .fdh file", file->path);
    if (file->bytes[7] != '1' || head[VERSION] != FORMAT)
        return fail(file, "%.150s is of another version of fdh; make it again with the version of this plug-in", file->path);
    if (head[LENGTH] != size || head[SECTIONS] < 1 || head[SECTIONS] > (size / 8 - HEAD_WORDS) / SECTION_WORDS)
        return fail(file, "%.150s is damaged: it is cut, or was changed", file->path);
    int64_t listed = 8 * SECTION_WORDS * head[SECTIONS];
    if (checksum(file->bytes + 8 * HEAD_WORDS, listed) != (uint64_t)head[TABLE_SUM])
        return fail(file, "%.150s is damaged: its list of sections was changed", file->path);
    if (head[SOURCES] != FDH_SOURCES)
        return fail(file, "%.120s was made for other kernels; export the patch anew, which writes this plug-in, too", file->path);
    const int64_t *section = head + HEAD_WORDS;
    for (int64_t n = 0; n < head[SECTIONS]; n++, section += SECTION_WORDS) {
        int is_within = section[PLACE] >= 8 * HEAD_WORDS + listed && section[PLACE] % 8 == 0 && section[PACKED] >= 0 &&
                        section[PACKED] <= size - section[PLACE] && section[PLACE] <= size;
        if (!is_within || section[WHOLE] < 0 || section[WHOLE] % 8 || section[WHOLE] > (int64_t)1 << 32)
            return fail(file, "%.150s is damaged: a section lies outside it", file->path);
    }
    file->id = (uint32_t)head[TABLE_SUM];
    return 0;
}

/* Unpack a section to memory that is to be freed. */
static void *unpack(fdh_file *file, int kind, int rate, int64_t *size) {
    const int64_t *section = find_section(file, kind, rate);
    unsigned char *planes = NULL, *words = NULL;
    if (!section) return fail(file, "%.150s has no section %d at %d Hz", file->path, kind, rate), NULL;
    const unsigned char *packed = file->bytes + section[PLACE];
    int64_t count = section[WHOLE] / 8;
    *size = section[WHOLE];
    planes = malloc((size_t)*size + 8), words = calloc((size_t)*size + 8, 1);
    int is_good = planes && words && checksum(packed, section[PACKED]) == (uint64_t)section[PACKED_SUM] &&
                  fdh_inflate(packed, section[PACKED], planes, *size) == 0;
    if (is_good)
        for (int k = 0; k < 8; k++)
            for (int64_t n = 0; n < count; n++) words[8 * n + k] = planes[k * count + n];
    free(planes);
    if (is_good && checksum(words, *size) == (uint64_t)section[SUM]) return words;
    free(words);
    return fail(file, "%.150s is damaged, or there is no memory to unpack it", file->path), NULL;
}

static int is_text(const char *text) { /* whole characters of UTF-8, none of them a control character */
    for (const unsigned char *at = (const unsigned char *)text; *at;) {
        int more = *at < 0x80 ? 0 : *at >= 0xf0 ? 3 : *at >= 0xe0 ? 2 : *at >= 0xc2 ? 1 : -1;
        if (more < 0 || *at > 0xf4 || *at < 0x20) return 0;
        for (at++; more > 0; more--)
            if ((*at++ & 0xc0) != 0x80) return 0;
    }
    return 1;
}

static int read_texts(fdh_file *file) {
    int64_t size, count = FDH_TEXTS + file->keys + 2 * file->controls, n = 0;
    char *joined = unpack(file, TEXTS, 0, &size);
    if (!joined) return -1;
    if ((file->texts = calloc((size_t)count + 1, sizeof *file->texts)) == NULL) return free(joined), -1;
    file->texts[0] = joined;
    joined[size] = 0;
    for (char *at = joined; n < count && at < joined + size; at += strlen(at) + 1) {
        if (!is_text(at)) break;
        file->texts[n++] = at;
    }
    return n == count ? 0 : fail(file, "%.150s is damaged: its names are no texts", file->path);
}

static int read_numbers(fdh_file *file) {
    int64_t size, *numbers = unpack(file, NUMBERS, 0, &size);
    if (!numbers) return -1;
    int is_good = size == 8 * NUMBER_COUNT && numbers[0] >= 1 && numbers[0] <= FDH_MAX_CHANNELS && numbers[1] >= 0 &&
                  numbers[1] <= FDH_MAX_KEYS && numbers[2] >= 0 && numbers[2] <= FDH_MAX_KEYS && numbers[3] >= 0 &&
                  numbers[3] <= 65536 && numbers[4] >= 1 && numbers[4] <= FDH_MAX_RATES;
    if (is_good) {
        file->channels = (int)numbers[0], file->polyphony = (int)numbers[1], file->keys = (int)numbers[2];
        file->controls = (int)numbers[3], file->rate_count = (int)numbers[4];
        memcpy(&file->gain, numbers + 5, sizeof file->gain);
        is_good = file->gain > 0.0 && file->gain < 1e300;
    }
    free(numbers);
    return is_good ? 0 : fail(file, "%.150s is damaged: its numbers are impossible", file->path);
}

static int read_levels(fdh_file *file) {
    int64_t size, *levels = unpack(file, LEVELS, 0, &size);
    if (!levels) return -1;
    int is_good = size == 8 * (FDH_LEVELS + 1 + 128) && levels[0] == 1 && levels[FDH_LEVELS - 1] == 127;
    for (int n = 1; is_good && n < FDH_LEVELS; n++) is_good = levels[n] > levels[n - 1];
    for (int n = 0; is_good && n < 128; n++)
        is_good = levels[FDH_LEVELS + 1 + n] >= 0 && levels[FDH_LEVELS + 1 + n] <= FDH_PEDAL_STEPS;
    if (is_good) {
        memcpy(file->levels, levels, sizeof file->levels);
        file->pedal_down = levels[FDH_LEVELS];
        memcpy(file->shares, levels + FDH_LEVELS + 1, sizeof file->shares);
    }
    free(levels);
    return is_good ? 0 : fail(file, "%.150s is damaged: its velocities are impossible", file->path);
}

static int check_rows(fdh_rows rows, int64_t count) { return rows.first >= 0 && rows.count >= 0 && rows.first <= count - rows.count; }

static int check_controls(const fdh_file *file, const fdh_control *controls, int64_t rows, int64_t positions) {
    for (int n = 0; n < file->controls; n++) {
        const fdh_control *c = controls + n;
        int64_t last = c->first_position + c->count;
        int is_good = c->kind >= FDH_SLIDER && c->kind <= FDH_WHEEL && check_rows((fdh_rows){c->first, c->count}, rows) &&
                      c->low < c->high && c->home >= c->low && c->home <= c->high && !(c->is_logarithmic && c->low <= 0.0);
        if (c->kind != FDH_SLIDER) is_good = is_good && c->count > 0 && c->first_position >= 0 && last <= positions;
        if (!is_good) return -1;
    }
    return 0;
}

static int check_keys(const fdh_file *file, const fdh_key *keys, int64_t rows) {
    for (int n = 0; n < file->keys; n++) {
        const fdh_rows *first = keys[n].on;
        int spans = (int)((sizeof(fdh_key) - 2 * sizeof(int64_t)) / sizeof(fdh_rows)), is_good = keys[n].number >= 0;
        for (int k = 0; k < spans; k++) is_good = is_good && check_rows(first[k], rows);
        if (!is_good || keys[n].number >= FDH_MAX_KEYS) return -1;
    }
    return 0;
}

/* Read what the first sample rate says of keys and controls: their numbers and ranges are those of all. */
static int read_about(fdh_file *file) {
    int64_t size, listed = 0, rate = 0, positions, rows;
    const int64_t *section = words_of(file) + HEAD_WORDS;
    for (int64_t n = 0; n < words_of(file)[SECTIONS]; n++, section += SECTION_WORDS)
        if (section[KIND] == OF_RATE && listed < FDH_MAX_RATES) file->rates[listed++] = (int)section[RATE];
    for (int n = 0; n < listed; n++)
        if (file->rates[n] < 1000 || file->rates[n] > 1000000) return fail(file, "%.150s is damaged: its rates are impossible", file->path);
    if (listed != file->rate_count) return fail(file, "%.150s is damaged: a sample rate is missing", file->path);
    rate = file->rates[0];
    const int64_t *of_positions = find_section(file, POSITIONS, (int)rate), *of_rows = find_section(file, ROWS, (int)rate);
    positions = of_positions ? of_positions[WHOLE] / 8 : 0, rows = of_rows ? of_rows[WHOLE] / (int64_t)sizeof(fdh_row) : 0;
    file->about_controls = unpack(file, CONTROLS, (int)rate, &size);
    if (!file->about_controls) return -1;
    if (size != (int64_t)sizeof(fdh_control) * file->controls || check_controls(file, file->about_controls, rows, positions))
        return fail(file, "%.150s is damaged: a control is impossible", file->path);
    file->about_keys = unpack(file, KEYS, (int)rate, &size);
    if (!file->about_keys) return -1;
    if (size != (int64_t)sizeof(fdh_key) * file->keys || check_keys(file, file->about_keys, rows))
        return fail(file, "%.150s is damaged: a key is impossible", file->path);
    return 0;
}

static char lock; /* of the list of files and of their sample rates; never held by the audio thread */
static fdh_file *opened;

static void begin_alone(void) {
    while (__atomic_test_and_set(&lock, __ATOMIC_ACQUIRE)) {
    }
}

static void end_alone(void) { __atomic_clear(&lock, __ATOMIC_RELEASE); }

static fdh_file *find_opened(const char *path) {
    fdh_file *file = opened;
    while (file && strcmp(file->path, path)) file = file->next;
    return file;
}

static fdh_file *read_file(const char *path) {
    fdh_file *file = calloc(1, sizeof *file);
    if (!file) return NULL;
    snprintf(file->path, sizeof file->path, "%s", path);
    int fault = read_bytes(file) || check_head(file) || read_numbers(file) || read_levels(file) || read_texts(file) || read_about(file);
    if (fault && !file->fault[0]) fail(file, "%.150s cannot be read", path);
    return file;
}

fdh_file *fdh_open(const char *path) {
    begin_alone();
    fdh_file *file = find_opened(path);
    if (!file && (file = read_file(path)) != NULL) file->next = opened, opened = file;
    if (file) file->users++;
    end_alone();
    return file;
}

static void forget(fdh_file *file) {
    fdh_file **at = &opened;
    while (*at != file) at = &(*at)->next;
    *at = file->next;
    free(file->bytes);
    if (file->texts) free(file->texts[0]);
    free(file->texts);
    free((void *)(uintptr_t)file->about_controls);
    free((void *)(uintptr_t)file->about_keys);
    free(file);
}

void fdh_close(fdh_file *file) {
    if (!file) return;
    begin_alone();
    if (--file->users == 0) forget(file);
    end_alone();
}

static const char *text_at(const fdh_file *file, int n) { return file->texts && file->texts[n] ? file->texts[n] : ""; }
const char *fdh_text(const fdh_file *file, int which) { return text_at(file, which); }
const char *fdh_key_name(const fdh_file *file, int key) { return text_at(file, FDH_TEXTS + key); }
const char *fdh_control_name(const fdh_file *file, int control) { return text_at(file, FDH_TEXTS + file->keys + 2 * control); }
const char *fdh_control_unit(const fdh_file *file, int control) { return text_at(file, FDH_TEXTS + file->keys + 2 * control + 1); }

/* --- a sample rate */

static int is_private(const fdh_rate *at, int64_t place, int64_t bytes) {
    return place >= 0 && place % 8 == 0 && bytes >= 0 && bytes <= at->private_size && place <= at->private_size - bytes;
}

static int is_anywhere(const fdh_rate *at, int64_t place, int64_t bytes) {
    if (!(place & IS_SHARED)) return is_private(at, place, bytes);
    place &= ~IS_SHARED;
    return place >= 0 && place % 8 == 0 && bytes >= 0 && bytes <= at->shared_size && place <= at->shared_size - bytes;
}

static int check_pointers(const fdh_rate *at) {
    int64_t place;
    for (int64_t n = 0; n < at->pointer_count; n++) {
        if (!is_private(at, at->pointers[n], 8) || (n && at->pointers[n] <= at->pointers[n - 1])) return -1;
        memcpy(&place, at->private_bytes + at->pointers[n], 8);
        if (!is_anywhere(at, place, 0)) return -1;
    }
    return 0;
}

static int is_pointer(const fdh_rate *at, int64_t place) {
    int64_t low = 0, high = at->pointer_count;
    while (low < high) {
        int64_t middle = (low + high) / 2;
        if (at->pointers[middle] < place) low = middle + 1;
        else high = middle;
    }
    return low < at->pointer_count && at->pointers[low] == place;
}

/* Exchanges of tables write where the file says: each copy goes from a part to the private part, by addresses. */
static int check_copies(const fdh_rate *at, int64_t table, int64_t count) {
    if (count < 0 || count > at->private_size / 24 || !is_private(at, table, 24 * count)) return -1;
    for (int64_t n = 0; n < count; n++, table += 24) {
        int64_t copy[3];
        memcpy(copy, at->private_bytes + table, sizeof copy);
        if (!is_pointer(at, table) || !is_pointer(at, table + 8) || copy[2] < 0 || copy[2] > at->private_size / 8) return -1;
        if (!is_private(at, copy[0], 8 * copy[2]) || !is_anywhere(at, copy[1], 8 * copy[2])) return -1;
    }
    return 0;
}

static int check_event(const fdh_rate *at, const fdh_row *row) {
    const int64_t *n = row->number, islands = at->numbers[FDH_RATE_ISLANDS];
    if (n[0] < 0 || n[0] >= FDH_KINDS || n[1] < 0 || n[1] >= islands || n[4] < 0 || n[5] < 0 || n[4] > (int64_t)1 << 40) return -1;
    if (n[2] < 0 || n[3] < n[2] || n[3] > at->private_size / 8) return -1;
    if (n[0] != FDH_EXCHANGE) return row->table == -1 ? 0 : -1;
    return n[3] > islands ? -1 : check_copies(at, row->table, n[5]);
}

static int check_rate(const fdh_rate *at) {
    const int64_t *n = at->numbers, islands = n[FDH_RATE_ISLANDS];
    int64_t sizes[FDH_RATE_NUMBERS] = {0};
    sizes[FDH_RATE_MEMORY] = sizes[FDH_RATE_RENDER_AT] = sizes[FDH_RATE_INSERT_AT] = 8;
    sizes[FDH_RATE_COUNTERS] = 8 * FDH_SLOTS, sizes[FDH_RATE_GAUGES] = 8 * FDH_GAUGES;
    sizes[FDH_RATE_EVENTS] = 8 * FDH_EVENT * FDH_QUEUE, sizes[FDH_RATE_VALUES] = 8 * FDH_VALUES * FDH_QUEUE;
    sizes[FDH_RATE_BALANCE] = 8 * FDH_BALANCE;
    if (islands < 1 || islands > 1 << 20 || n[FDH_RATE_REST] < 1 || n[FDH_RATE_REST] > 64) return -1;
    sizes[FDH_RATE_SLEEP] = 8 * islands * n[FDH_RATE_REST];
    for (int k = FDH_RATE_MEMORY; k < FDH_RATE_NUMBERS; k++)
        if (!is_private(at, n[k], sizes[k])) return -1;
    if (check_pointers(at)) return -1;
    for (int64_t k = 0; k < at->row_count; k++)
        if (check_event(at, at->rows + k)) return -1;
    return 0;
}

static unsigned char *aligned(unsigned char *memory) { return memory + (ALIGNMENT - (uintptr_t)memory % ALIGNMENT) % ALIGNMENT; }

static void free_rate(fdh_rate *at) {
    free((void *)(uintptr_t)at->numbers);
    free((void *)(uintptr_t)at->pointers);
    free((void *)(uintptr_t)at->rows);
    free((void *)(uintptr_t)at->keys);
    free((void *)(uintptr_t)at->controls);
    free((void *)(uintptr_t)at->positions);
    free(at->private_bytes);
    free(at->memory);
    memset(at, 0, sizeof *at);
}

static int unpack_rate(fdh_file *file, fdh_rate *at, int rate) {
    int64_t size, controls, keys, positions;
    at->rate = rate;
    if (!(at->numbers = unpack(file, OF_RATE, rate, &size)) || size != 8 * FDH_RATE_NUMBERS) return -1;
    unsigned char *shared = unpack(file, SHARED, rate, &at->shared_size);
    if (!shared) return -1;
    at->memory = malloc((size_t)at->shared_size + 2 * ALIGNMENT);
    if (at->memory) at->shared = memcpy(aligned(at->memory), shared, (size_t)at->shared_size);
    free(shared);
    if (!at->memory || !(at->private_bytes = unpack(file, PRIVATE, rate, &at->private_size))) return -1;
    if (!(at->pointers = unpack(file, POINTERS, rate, &size))) return -1;
    at->pointer_count = size / 8;
    if (!(at->rows = unpack(file, ROWS, rate, &size))) return -1;
    at->row_count = size / (int64_t)sizeof(fdh_row);
    if (!(at->keys = unpack(file, KEYS, rate, &keys)) || !(at->controls = unpack(file, CONTROLS, rate, &controls))) return -1;
    if (!(at->positions = unpack(file, POSITIONS, rate, &positions))) return -1;
    int is_good = keys == (int64_t)sizeof(fdh_key) * file->keys && controls == (int64_t)sizeof(fdh_control) * file->controls &&
                  !check_keys(file, at->keys, at->row_count) &&
                  !check_controls(file, at->controls, at->row_count, positions / 8) && !check_rate(at);
    return is_good ? 0 : fail(file, "%.150s is damaged: a place in it is impossible", file->path);
}

const fdh_rate *fdh_take_rate(fdh_file *file, int index) {
    begin_alone();
    fdh_rate *at = file->at + index;
    if (at->players == 0 && unpack_rate(file, at, file->rates[index])) {
        if (!file->fault[0]) fail(file, "%.150s cannot be unpacked at %d Hz", file->path, file->rates[index]);
        free_rate(at);
        at = NULL;
    } else {
        at->players++;
    }
    end_alone();
    return at;
}

void fdh_release_rate(fdh_file *file, const fdh_rate *rate) {
    begin_alone();
    fdh_rate *at = file->at + (rate - file->at);
    if (--at->players == 0) free_rate(at);
    end_alone();
}
