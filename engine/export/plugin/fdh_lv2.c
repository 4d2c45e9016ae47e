/* A patch as a plug-in of LV2. Its data lie in the bundle, as `patch.fdh`; the ports are those that engine/export/lv2_text.py
 * describes: MIDI, outputs, latency, lost events, parameters. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fdh_midi.h"
#include "lv2_abi.h"

enum { AT_ONCE = 256 };

typedef struct {
    fdh_file *file;
    fdh_player *player;
    LV2_URID midi;
    const LV2_Atom_Sequence *events;
    float **outputs, *latency, *lost, *interleaved;
    const float **values; /* of parameters, as the host has them … */
    float *before;        /* … and as they were */
    int *controls, count; /* those that are parameters: the wheel is MIDI's */
} plug;

static fdh_file *open_data(const char *bundle) {
    char path[1024];
    size_t length = strlen(bundle);
    int has_slash = length && (bundle[length - 1] == '/' || bundle[length - 1] == '\\');
    snprintf(path, sizeof path, "%.990s%spatch.fdh", bundle, has_slash ? "" : "/");
    return fdh_open(path);
}

static const void *find_feature(const LV2_Feature *const *features, const char *uri) {
    for (; features && *features; features++)
        if (!strcmp((*features)->URI, uri)) return (*features)->data;
    return NULL;
}

static void tell(const LV2_Feature *const *features, const char *fault) {
    const LV2_Log_Log *log = find_feature(features, LV2_LOG_URI);
    const LV2_URID_Map *map = find_feature(features, LV2_URID_MAP_URI);
    if (log && map) log->printf(log->handle, map->map(map->handle, LV2_LOG_ERROR_URI), "fdh: %s\n", fault);
    else fprintf(stderr, "fdh: %s\n", fault);
}

static void cleanup(LV2_Handle handle) {
    plug *me = handle;
    fdh_destroy(me->player);
    fdh_close(me->file);
    free(me->outputs), free(me->interleaved), free(me->values), free(me->before), free(me->controls), free(me);
}

static int make_ports(plug *me) {
    const fdh_file *file = me->file;
    size_t count = (size_t)file->controls + 1;
    me->outputs = calloc((size_t)file->channels, sizeof *me->outputs);
    me->interleaved = calloc((size_t)AT_ONCE * file->channels, sizeof *me->interleaved);
    me->values = calloc(count, sizeof *me->values), me->before = calloc(count, sizeof *me->before);
    me->controls = calloc(count, sizeof *me->controls);
    if (!me->outputs || !me->interleaved || !me->values || !me->before || !me->controls) return -1;
    for (int n = 0; n < file->controls; n++) {
        if (file->about_controls[n].kind == FDH_WHEEL) continue;
        me->controls[me->count] = n;
        me->before[me->count++] = (float)file->about_controls[n].home;
    }
    return 0;
}

static LV2_Handle instantiate(const LV2_Descriptor *descriptor, double rate, const char *bundle, const LV2_Feature *const *features) {
    char fault[FDH_FAULT] = "there is no memory";
    const LV2_URID_Map *map = find_feature(features, LV2_URID_MAP_URI);
    plug *me = calloc(1, sizeof *me);
    (void)descriptor;
    if (!me || !map) return free(me), NULL;
    me->midi = map->map(map->handle, LV2_MIDI_EVENT_URI);
    me->file = open_data(bundle);
    if (me->file) me->player = fdh_create(me->file, rate, fault);
    if (me->player && make_ports(me) == 0) return me;
    tell(features, fault);
    cleanup(me);
    return NULL;
}

static void connect_port(LV2_Handle handle, uint32_t port, void *data) {
    plug *me = handle;
    uint32_t outputs = (uint32_t)me->file->channels, first = outputs + 3;
    if (port == 0) me->events = data;
    else if (port <= outputs) me->outputs[port - 1] = data;
    else if (port == outputs + 1) me->latency = data;
    else if (port == outputs + 2) me->lost = data;
    else if (port - first < (uint32_t)me->count) me->values[port - first] = data;
}

static void activate(LV2_Handle handle) {
    plug *me = handle;
    fdh_reset(me->player);
    for (int n = 0; n < me->count; n++) me->before[n] = (float)me->file->about_controls[me->controls[n]].home;
}

static void set_parameters(plug *me) {
    for (int n = 0; n < me->count; n++) {
        const float *value = me->values[n];
        double home = me->file->about_controls[me->controls[n]].home;
        if (!value || *value == me->before[n]) continue;
        me->before[n] = *value;
        fdh_set(me->player, me->controls[n], *value == (float)home ? home : (double)*value);
    }
}

static void render(plug *me, uint32_t *done, uint32_t end) {
    int channels = me->file->channels;
    while (*done < end) {
        uint32_t count = end - *done < AT_ONCE ? end - *done : AT_ONCE;
        fdh_process(me->player, me->interleaved, (int)count);
        for (int c = 0; c < channels; c++)
            for (uint32_t i = 0; me->outputs[c] && i < count; i++) me->outputs[c][*done + i] = me->interleaved[i * (uint32_t)channels + (uint32_t)c];
        *done += count;
    }
}

static void run(LV2_Handle handle, uint32_t frames) {
    plug *me = handle;
    uint32_t done = 0, size = me->events ? me->events->atom.size : 0;
    const unsigned char *at = me->events ? (const unsigned char *)(me->events + 1) : NULL;
    const unsigned char *end = me->events ? (const unsigned char *)&me->events->unit + size : NULL;
    set_parameters(me);
    while (at && at + sizeof(LV2_Atom_Event) <= end) {
        const LV2_Atom_Event *event = (const void *)at;
        int64_t frame = event->time.frames;
        at += sizeof *event + (event->body.size + 7) / 8 * 8;
        if (event->body.type != me->midi || event->body.size < 2) continue;
        uint8_t message[3] = {0};
        memcpy(message, event + 1, event->body.size < 3 ? event->body.size : 3);
        render(me, &done, frame < 0 ? 0 : frame < frames ? (uint32_t)frame : frames);
        fdh_midi(me->player, me->file, message);
    }
    render(me, &done, frames);
    if (me->latency) *me->latency = (float)fdh_latency(me->player);
    if (me->lost) *me->lost = (float)fdh_lost(me->player);
}

/* --- the library: one plug-in for each bundle that it lies in */

typedef struct {
    LV2_Lib_Descriptor library;
    LV2_Descriptor plugin;
    char uri[300];
} bundle;

static void forget(LV2_Lib_Handle handle) { free(handle); }

static const LV2_Descriptor *describe(LV2_Lib_Handle handle, uint32_t index) { return index ? NULL : &((bundle *)handle)->plugin; }

LV2_SYMBOL_EXPORT const LV2_Lib_Descriptor *lv2_lib_descriptor(const char *path, const LV2_Feature *const *features) {
    fdh_file *file = open_data(path);
    bundle *made = file && !file->fault[0] ? calloc(1, sizeof *made) : NULL;
    if (!made) tell(features, file ? file->fault : "there is no memory");
    else {
        snprintf(made->uri, sizeof made->uri, "urn:fdh-engine:%.250s", fdh_text(file, FDH_NAME));
        made->plugin = (LV2_Descriptor){made->uri, instantiate, connect_port, activate, run, NULL, cleanup, NULL};
        made->library = (LV2_Lib_Descriptor){made, sizeof(LV2_Lib_Descriptor), forget, describe};
    }
    fdh_close(file);
    return made ? &made->library : NULL;
}
