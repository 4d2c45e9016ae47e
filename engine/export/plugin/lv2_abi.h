/* What a plug-in needs of LV2 1.18 (https://lv2plug.in): names and layouts as the standard has them. A test holds this
 * against the standard's own headers. */
#ifndef LV2_ABI_H
#define LV2_ABI_H

#include <stdint.h>

typedef void *LV2_Handle;
typedef uint32_t LV2_URID;
typedef struct { const char *URI; void *data; } LV2_Feature;
typedef struct { void *handle; LV2_URID (*map)(void *handle, const char *uri); } LV2_URID_Map;
typedef struct LV2_Descriptor {
    const char *URI;
    LV2_Handle (*instantiate)(const struct LV2_Descriptor *, double rate, const char *bundle, const LV2_Feature *const *);
    void (*connect_port)(LV2_Handle, uint32_t port, void *data);
    void (*activate)(LV2_Handle);
    void (*run)(LV2_Handle, uint32_t frames);
    void (*deactivate)(LV2_Handle);
    void (*cleanup)(LV2_Handle);
    const void *(*extension_data)(const char *uri);
} LV2_Descriptor;
typedef void *LV2_Lib_Handle;
typedef struct {
    LV2_Lib_Handle handle;
    uint32_t size;
    void (*cleanup)(LV2_Lib_Handle);
    const LV2_Descriptor *(*get_plugin)(LV2_Lib_Handle, uint32_t index);
} LV2_Lib_Descriptor;

typedef struct { uint32_t size, type; } LV2_Atom;
typedef struct { LV2_Atom atom; uint32_t unit, pad; } LV2_Atom_Sequence; /* events follow */
typedef struct {
    union { int64_t frames; double beats; } time;
    LV2_Atom body; /* its content follows; the next event begins at a multiple of 8 */
} LV2_Atom_Event;
typedef struct {
    void *handle;
    int (*printf)(void *handle, LV2_URID type, const char *format, ...);
    int (*vprintf)(void *handle, LV2_URID type, const char *format, __builtin_va_list);
} LV2_Log_Log;

#define LV2_URID_MAP_URI "http://lv2plug.in/ns/ext/urid#map"
#define LV2_LOG_URI "http://lv2plug.in/ns/ext/log#log"
#define LV2_LOG_ERROR_URI "http://lv2plug.in/ns/ext/log#Error"
#define LV2_MIDI_EVENT_URI "http://lv2plug.in/ns/ext/midi#MidiEvent"
#ifdef _WIN32
#define LV2_SYMBOL_EXPORT __declspec(dllexport)
#else
#define LV2_SYMBOL_EXPORT __attribute__((visibility("default")))
#endif
#endif
