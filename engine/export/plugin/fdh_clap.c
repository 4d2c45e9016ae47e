/* A patch as a plug-in of CLAP. Its data lie beside the binary, under the same name with the ending .fdh; in a bundle of
 * macOS, among its resources. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clap_abi.h"
#include "fdh_midi.h"

enum { AT_ONCE = 256, STATE_BYTES = 1 << 20, LINE = 512 };
static const clap_id STATUS = 1; /* the parameter that says what was lost */
static const char FACTORY_ID[] = "clap.plugin-factory";
static const char *FEATURES[] = {"instrument", "synthesizer", "physical-modeling", NULL};

static fdh_file *file;
static char name[FDH_FAULT], id[FDH_FAULT + 16], description[FDH_FAULT];
static clap_plugin_descriptor_t descriptor;

typedef struct {
    clap_plugin_t clap;
    const clap_host_t *host;
    fdh_player *player; /* while it is active */
    float *interleaved;
    double *wanted, *moved; /* places of all parameters, which outlive the player, and by how far they are modulated */
    char *is_due; /* whether the player has yet to hear of them */
    clap_event_note_t notes[FDH_MAX_KEYS]; /* last of each key */
} plug;

static plug *of(const clap_plugin_t *p) { return p->plugin_data; }

static void tell(const clap_host_t *host, int severity, const char *message) {
    const clap_host_log_t *log = host && host->get_extension ? host->get_extension(host, "clap.log") : NULL;
    if (log && log->log) log->log(host, severity, message);
    else fprintf(stderr, "%s: %s\n", name, message);
}

/* --- parameters: a logarithmic one is moved by its place between both ends, 0 to 1 */

static const fdh_control *control_of(int n) { return file->about_controls + n; }

static double value_of(int n, double place) {
    const fdh_control *c = control_of(n);
    double value = c->is_logarithmic ? c->low * pow(c->high / c->low, place) : place;
    return value < c->low ? c->low : value > c->high ? c->high : value;
}

static double place_of(int n, double value) {
    const fdh_control *c = control_of(n);
    return c->is_logarithmic ? log(value / c->low) / log(c->high / c->low) : value;
}

static clap_id id_of(int n) { /* of its name, so that an export with other parameters keeps the automation */
    uint32_t hash = 2166136261u;
    for (const char *at = fdh_control_name(file, n); *at; at++) hash = (hash ^ (unsigned char)*at) * 16777619u;
    return hash | 2;
}

static int find_parameter(clap_id wanted) {
    for (int n = 0; n < file->controls; n++)
        if (id_of(n) == wanted) return n;
    return -1;
}

static uint32_t count_parameters(const clap_plugin_t *p) { return (void)p, (uint32_t)file->controls + 1; }

static bool describe_parameter(const clap_plugin_t *p, uint32_t index, clap_param_info_t *info) {
    (void)p;
    if (index > (uint32_t)file->controls) return false;
    memset(info, 0, sizeof *info);
    if (index == (uint32_t)file->controls) {
        info->id = STATUS, info->flags = CLAP_PARAM_IS_READONLY, info->max_value = 1e9;
        snprintf(info->name, sizeof info->name, "lost events");
        return true;
    }
    const fdh_control *c = control_of((int)index);
    info->id = id_of((int)index), info->flags = CLAP_PARAM_IS_AUTOMATABLE | CLAP_PARAM_IS_MODULATABLE;
    snprintf(info->name, sizeof info->name, "%s", c->kind == FDH_WHEEL ? "pitch" : fdh_control_name(file, (int)index));
    info->min_value = c->is_logarithmic ? 0.0 : c->low, info->max_value = c->is_logarithmic ? 1.0 : c->high;
    info->default_value = place_of((int)index, c->home);
    return true;
}

static bool get_value(const clap_plugin_t *p, clap_id which, double *value) {
    int n = find_parameter(which);
    if (which == STATUS) *value = of(p)->player ? (double)fdh_lost(of(p)->player) : 0.0;
    else if (n >= 0) *value = of(p)->wanted[n];
    return n >= 0 || which == STATUS;
}

static bool value_to_text(const clap_plugin_t *p, clap_id which, double value, char *text, uint32_t size) {
    int n = find_parameter(which);
    if (which == STATUS) {
        double error = of(p)->player ? fdh_energy_error(of(p)->player) : 0.0;
        snprintf(text, size, "%.0f events lost; energy error %.1e", value, error);
        return true;
    }
    if (n < 0) return false;
    snprintf(text, size, "%.6g %s", value_of(n, value), fdh_control_unit(file, n));
    return true;
}

static bool text_to_value(const clap_plugin_t *p, clap_id which, const char *text, double *value) {
    char *end;
    int n = find_parameter(which);
    double read = strtod(text, &end);
    (void)p;
    if (n < 0 || end == text || !(read >= control_of(n)->low && read <= control_of(n)->high)) return false;
    *value = place_of(n, read);
    return true;
}

static void send_parameter(plug *me, int n) {
    const fdh_control *c = control_of(n);
    double place = me->wanted[n] + me->moved[n];
    me->is_due[n] = 0;
    if (c->is_logarithmic) place = place < 0.0 ? 0.0 : place > 1.0 ? 1.0 : place;
    /* the value of the patch itself, though the place is rounded */
    fdh_set(me->player, n, place == place_of(n, c->home) ? c->home : value_of(n, place));
}

static void take_parameter(plug *me, const clap_event_param_value_t *event, double *of_all) {
    int n = find_parameter(event->param_id);
    if (n < 0 || event->key >= 0 || event->note_id >= 0 || !(event->value == event->value)) return; /* of no single note */
    of_all[n] = event->value;
    if (me->player) send_parameter(me, n);
    else me->is_due[n] = 1;
}

/* --- events */

static void take_note(plug *me, const clap_event_note_t *note, int type) {
    int first = note->key < 0 ? 0 : fdh_find_key(file, note->key), last = note->key < 0 ? file->keys - 1 : first;
    for (int n = first; n <= last && n >= 0; n++) {
        if (note->note_id >= 0 && note->key < 0 && me->notes[n].note_id != note->note_id) continue;
        if (type == CLAP_EVENT_NOTE_OFF) fdh_note_off(me->player, n);
        else fdh_choke(me->player, n);
    }
}

static void begin_note(plug *me, const clap_event_note_t *note) {
    int n = note->key < 0 ? -1 : fdh_find_key(file, note->key);
    double velocity = note->velocity * 127.0, whole = round(velocity);
    if (n < 0) return;
    if (fabs(velocity - whole) < 1e-4) velocity = whole; /* of a key of MIDI, but for rounding */
    if (fdh_note_on(me->player, n, velocity < 1.0 ? 1.0 : velocity) == 0) me->notes[n] = *note;
}

static void take(plug *me, const clap_event_header_t *event) {
    if (event->space_id != 0) return;
    if (event->type == CLAP_EVENT_PARAM_VALUE) take_parameter(me, (const void *)event, me->wanted);
    else if (event->type == CLAP_EVENT_PARAM_MOD) take_parameter(me, (const void *)event, me->moved);
    else if (!me->player) return;
    else if (event->type == CLAP_EVENT_NOTE_ON) begin_note(me, (const void *)event);
    else if (event->type == CLAP_EVENT_NOTE_OFF || event->type == CLAP_EVENT_NOTE_CHOKE) take_note(me, (const void *)event, event->type);
    else if (event->type == CLAP_EVENT_MIDI) fdh_midi(me->player, file, ((const clap_event_midi_t *)(const void *)event)->data);
}

static void flush(const clap_plugin_t *p, const clap_input_events_t *in, const clap_output_events_t *out) {
    (void)out;
    for (uint32_t i = 0, n = in->size(in); i < n; i++) {
        const clap_event_header_t *event = in->get(in, i);
        if (event->type == CLAP_EVENT_PARAM_VALUE || event->type == CLAP_EVENT_PARAM_MOD) take(of(p), event);
    }
}

static void tell_ends(plug *me, const clap_output_events_t *out, uint32_t frames) {
    for (int n = 0; out && n < file->keys; n++) {
        if (!fdh_note_ended(me->player, n)) continue;
        clap_event_note_t end = me->notes[n];
        end.header = (clap_event_header_t){sizeof end, frames ? frames - 1 : 0, 0, CLAP_EVENT_NOTE_END, 0};
        out->try_push(out, &end.header);
    }
}

/* --- sound */

static void render(plug *me, const clap_process_t *block, uint32_t *done, uint32_t end) {
    uint32_t channels = (uint32_t)file->channels;
    while (*done < end) {
        uint32_t count = end - *done < AT_ONCE ? end - *done : AT_ONCE;
        fdh_process(me->player, me->interleaved, (int)count);
        for (uint32_t c = 0; block->audio_outputs_count && c < block->audio_outputs[0].channel_count; c++)
            for (uint32_t i = 0; i < count; i++) {
                float sample = c < channels ? me->interleaved[i * channels + c] : 0.0f;
                if (block->audio_outputs[0].data32) block->audio_outputs[0].data32[c][*done + i] = sample;
                else block->audio_outputs[0].data64[c][*done + i] = sample;
            }
        *done += count;
    }
}

static clap_process_status process(const clap_plugin_t *p, const clap_process_t *block) {
    plug *me = of(p);
    if (!me->player) return CLAP_PROCESS_ERROR;
    uint32_t done = 0, count = block->in_events ? block->in_events->size(block->in_events) : 0;
    for (int n = 0; n < file->controls; n++)
        if (me->is_due[n]) send_parameter(me, n);
    for (uint32_t i = 0; i < count; i++) {
        const clap_event_header_t *event = block->in_events->get(block->in_events, i);
        render(me, block, &done, event->time < block->frames_count ? event->time : block->frames_count);
        take(me, event);
    }
    render(me, block, &done, block->frames_count);
    tell_ends(me, block->out_events, block->frames_count);
    return fdh_is_asleep(me->player) ? CLAP_PROCESS_SLEEP : CLAP_PROCESS_CONTINUE;
}

/* --- state: a line says which file, and a line for each parameter by name, in its own unit */

static bool write_whole(const clap_ostream_t *to, const char *text) {
    for (uint64_t size = strlen(text); size;) {
        int64_t wrote = to->write(to, text, size);
        if (wrote <= 0) return false;
        text += wrote, size -= (uint64_t)wrote;
    }
    return true;
}

static bool save(const clap_plugin_t *p, const clap_ostream_t *to) {
    char line[LINE];
    snprintf(line, sizeof line, "fdh 1 %08x %.200s\n", file->id, fdh_text(file, FDH_NAME));
    if (!write_whole(to, line)) return false;
    for (int n = 0; n < file->controls; n++) {
        snprintf(line, sizeof line, "%.17g %.200s\n", value_of(n, of(p)->wanted[n]), fdh_control_name(file, n));
        if (!write_whole(to, line)) return false;
    }
    return true;
}

static void restore_line(plug *me, const char *line, char *unknown) {
    char *end;
    double value = strtod(line, &end);
    for (int n = 0; end != line && *end == ' ' && value == value && n < file->controls; n++) {
        if (strcmp(fdh_control_name(file, n), end + 1)) continue;
        const fdh_control *c = control_of(n);
        me->wanted[n] = place_of(n, value < c->low ? c->low : value > c->high ? c->high : value);
        me->is_due[n] = 1;
        return;
    }
    if (!*unknown) snprintf(unknown, LINE, "the project has a parameter that this patch has not: %.200s", end == line ? line : end + 1);
}

static bool load(const clap_plugin_t *p, const clap_istream_t *from) {
    char *text = calloc(STATE_BYTES, 1), unknown[LINE] = "", said[LINE];
    int64_t size = 0, got;
    unsigned saved = 0;
    if (!text) return false;
    while (size < STATE_BYTES - 1 && (got = from->read(from, text + size, (uint64_t)(STATE_BYTES - 1 - size))) > 0) size += got;
    bool is_ours = sscanf(text, "fdh 1 %8x", &saved) == 1;
    if (!is_ours) tell(of(p)->host, CLAP_LOG_ERROR, "the project holds no state of this plug-in");
    else if (saved != file->id) {
        snprintf(said, sizeof said, "the project was saved with another file of %.200s; its values are taken over", fdh_text(file, FDH_NAME));
        tell(of(p)->host, CLAP_LOG_WARNING, said);
    }
    for (char *line = is_ours ? strchr(text, '\n') : NULL; line;) {
        char *next = strchr(++line, '\n');
        if (!next) break;
        *next = 0;
        restore_line(of(p), line, unknown);
        line = next;
    }
    if (*unknown) tell(of(p)->host, CLAP_LOG_WARNING, unknown);
    free(text);
    const clap_host_t *host = of(p)->host;
    const clap_host_params_t *params = host && host->get_extension ? host->get_extension(host, "clap.params") : NULL;
    if (is_ours && params && params->rescan) params->rescan(host, CLAP_PARAM_RESCAN_VALUES);
    return is_ours;
}

/* --- ports */

static uint32_t count_outputs(const clap_plugin_t *p, bool is_input) { return (void)p, !is_input; }

static bool describe_output(const clap_plugin_t *p, uint32_t index, bool is_input, clap_audio_port_info_t *info) {
    (void)p;
    if (is_input || index) return false;
    memset(info, 0, sizeof *info);
    snprintf(info->name, sizeof info->name, "out");
    info->flags = CLAP_AUDIO_PORT_IS_MAIN, info->channel_count = (uint32_t)file->channels;
    info->port_type = file->channels == 1 ? "mono" : file->channels == 2 ? "stereo" : NULL;
    info->in_place_pair = CLAP_INVALID_ID;
    return true;
}

static uint32_t count_note_ports(const clap_plugin_t *p, bool is_input) { return (void)p, is_input; }

static bool describe_note_port(const clap_plugin_t *p, uint32_t index, bool is_input, clap_note_port_info_t *info) {
    (void)p;
    if (!is_input || index) return false;
    memset(info, 0, sizeof *info);
    snprintf(info->name, sizeof info->name, "notes");
    info->supported_dialects = CLAP_NOTE_DIALECT_CLAP | CLAP_NOTE_DIALECT_MIDI;
    info->preferred_dialect = CLAP_NOTE_DIALECT_CLAP;
    return true;
}

static uint32_t count_names(const clap_plugin_t *p) { return (void)p, (uint32_t)file->keys; }

static bool name_key(const clap_plugin_t *p, uint32_t index, clap_note_name_t *named) {
    (void)p;
    if (index >= (uint32_t)file->keys) return false;
    snprintf(named->name, sizeof named->name, "%s", fdh_key_name(file, (int)index));
    named->port = named->channel = -1, named->key = (int16_t)file->about_keys[index].number;
    return true;
}

static uint32_t latency(const clap_plugin_t *p) { return of(p)->player ? (uint32_t)fdh_latency(of(p)->player) : 0; }
static uint32_t tail(const clap_plugin_t *p) { return (void)p, INT32_MAX; } /* endless, until it says that it sleeps */

static const clap_plugin_audio_ports_t AUDIO_PORTS = {count_outputs, describe_output};
static const clap_plugin_note_ports_t NOTE_PORTS = {count_note_ports, describe_note_port};
static const clap_plugin_note_name_t NOTE_NAMES = {count_names, name_key};
static const clap_plugin_latency_t LATENCY = {latency};
static const clap_plugin_tail_t TAIL = {tail};
static const clap_plugin_state_t STATE = {save, load};
static const clap_plugin_params_t PARAMS = {count_parameters, describe_parameter, get_value, value_to_text, text_to_value, flush};

static const void *get_extension(const clap_plugin_t *p, const char *wanted) {
    static const struct { const char *id; const void *extension; } ALL[] = {
        {"clap.audio-ports", &AUDIO_PORTS}, {"clap.note-ports", &NOTE_PORTS}, {"clap.note-name", &NOTE_NAMES},
        {"clap.latency", &LATENCY},         {"clap.tail", &TAIL},             {"clap.state", &STATE},
        {"clap.params", &PARAMS},
    };
    (void)p;
    for (size_t n = 0; n < sizeof ALL / sizeof *ALL; n++)
        if (!strcmp(ALL[n].id, wanted)) return ALL[n].extension;
    return NULL;
}

/* --- the plug-in */

static bool init(const clap_plugin_t *p) { return (void)p, true; }

static void deactivate(const clap_plugin_t *p) {
    fdh_destroy(of(p)->player);
    of(p)->player = NULL;
}

static void destroy(const clap_plugin_t *p) {
    plug *me = of(p);
    fdh_destroy(me->player);
    free(me->interleaved), free(me->wanted), free(me->moved), free(me->is_due), free(me);
}

static void send_all_later(plug *me) {
    for (int n = 0; n < file->controls; n++) me->is_due[n] = me->wanted[n] + me->moved[n] != place_of(n, control_of(n)->home);
}

static bool activate(const clap_plugin_t *p, double rate, uint32_t least, uint32_t most) {
    char fault[FDH_FAULT], said[2 * FDH_FAULT];
    plug *me = of(p);
    (void)least, (void)most;
    fdh_destroy(me->player);
    if ((me->player = fdh_create(file, rate, fault)) == NULL) {
        tell(me->host, CLAP_LOG_ERROR, fault);
        return false;
    }
    if (fdh_latency(me->player)) {
        snprintf(said, sizeof said, "%.200s has no tables for %.0f Hz and is resampled; export it with --rates %.0f", name, rate, rate);
        tell(me->host, CLAP_LOG_WARNING, said);
    }
    send_all_later(me);
    return true;
}

static void reset(const clap_plugin_t *p) {
    if (!of(p)->player) return;
    fdh_reset(of(p)->player);
    send_all_later(of(p));
}

static bool start_processing(const clap_plugin_t *p) { return of(p)->player != NULL; }
static void stop_processing(const clap_plugin_t *p) { (void)p; }
static void on_main_thread(const clap_plugin_t *p) { (void)p; }

static const clap_plugin_t *create(const clap_plugin_factory_t *factory, const clap_host_t *host, const char *wanted) {
    (void)factory;
    if (!file || strcmp(wanted, id)) return NULL;
    if (file->fault[0]) {
        tell(host, CLAP_LOG_ERROR, file->fault);
        return NULL;
    }
    plug *me = calloc(1, sizeof *me);
    size_t count = (size_t)file->controls + 1;
    if (!me) return NULL;
    me->host = host;
    me->wanted = calloc(count, sizeof(double)), me->moved = calloc(count, sizeof(double)), me->is_due = calloc(count, 1);
    me->interleaved = calloc((size_t)AT_ONCE * file->channels, sizeof(float));
    me->clap = (clap_plugin_t){&descriptor, me, init, destroy, activate, deactivate, start_processing, stop_processing, reset,
                               process, get_extension, on_main_thread};
    if (!me->wanted || !me->moved || !me->is_due || !me->interleaved) return destroy(&me->clap), NULL;
    for (int n = 0; n < file->controls; n++) me->wanted[n] = place_of(n, control_of(n)->home);
    return &me->clap;
}

static uint32_t count_plugins(const clap_plugin_factory_t *factory) { return (void)factory, file != NULL; }

static const clap_plugin_descriptor_t *describe_plugin(const clap_plugin_factory_t *factory, uint32_t index) {
    return (void)factory, index || !file ? NULL : &descriptor;
}

static const clap_plugin_factory_t FACTORY = {count_plugins, describe_plugin, create};

/* --- the library */

static void find_stem(const char *path, char *stem, size_t size) {
    const char *at = path;
    for (const char *c = path; *c; c++)
        if (*c == '/' || *c == '\\') at = c + 1;
    snprintf(stem, size, "%s", at);
    char *end = strrchr(stem, '.');
    if (end) *end = 0;
}

static bool open_library(const char *path) {
    char stem[200], data[1400];
    if (file) return true;
    find_stem(path, stem, sizeof stem);
#ifdef __APPLE__
    snprintf(data, sizeof data, "%s/Contents/Resources/%s.fdh", path, stem);
#else
    size_t length = strlen(path);
    snprintf(data, sizeof data, "%.*s.fdh", (int)(length > 5 && !strcmp(path + length - 5, ".clap") ? length - 5 : length), path);
#endif
    if ((file = fdh_open(data)) == NULL) return false;
    snprintf(name, sizeof name, "%.200s", *fdh_text(file, FDH_TITLE) ? fdh_text(file, FDH_TITLE) : stem);
    snprintf(id, sizeof id, "fdh-engine.%.200s", *fdh_text(file, FDH_NAME) ? fdh_text(file, FDH_NAME) : stem);
    const char *licence = fdh_text(file, FDH_LICENCE);
    snprintf(description, sizeof description, "computed by fdh-engine%s%.150s", *licence ? "; " : "", licence);
    const char *author = *fdh_text(file, FDH_AUTHOR) ? fdh_text(file, FDH_AUTHOR) : "fdh-engine";
    descriptor = (clap_plugin_descriptor_t){CLAP_VERSION_INIT, id, name, author, "", "", "", fdh_text(file, FDH_VERSION), description, FEATURES};
    return true;
}

static void close_library(void) {
    fdh_close(file);
    file = NULL;
}

static const void *get_factory(const char *wanted) { return strcmp(wanted, FACTORY_ID) ? NULL : &FACTORY; }

CLAP_EXPORT extern const clap_plugin_entry_t clap_entry;
CLAP_EXPORT const clap_plugin_entry_t clap_entry = {CLAP_VERSION_INIT, open_library, close_library, get_factory};
