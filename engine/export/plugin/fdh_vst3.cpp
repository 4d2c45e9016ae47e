/* A patch as a plug-in of VST3, by DPF (https://github.com/DISTRHO/DPF, ISC): compiled for the patch, whose name and number of
 * outputs are in DistrhoPluginInfo.h. Its data lie among the resources of the bundle. Parameter 0
 * says what was lost: DPF 1.6 takes the first for a controller of MIDI, so that it cannot be set. */
#include <cmath>
#include <cstring>
#include <string>
#include <vector>

#include "DistrhoPlugin.hpp"
#include "DistrhoPluginUtils.hpp"

extern "C" {
#include "fdh_midi.h"
}

START_NAMESPACE_DISTRHO

static const uint32_t AT_ONCE = 256, LOST = 0; /* parameter 0: events that were lost */

static std::string find_data() { /* …/Contents/SYSTEM/NAME.so → …/Contents/Resources/patch.fdh */
    std::string path = getBinaryFilename();
    for (int n = 0; n < 2; n++) path.resize(path.find_last_of("/\\") == std::string::npos ? 0 : path.find_last_of("/\\"));
    return path + "/Resources/patch.fdh";
}

class Patch : public Plugin {
public:
    explicit Patch(fdh_file *data) : Plugin(count_parameters(data), 0, 0), file(data), player(nullptr), values(FDH_PARAMETERS + 1) {
        for (int n = 0; n < count(); n++) values[1 + n] = (float)shown(n, control(n).home);
        interleaved.resize(AT_ONCE * FDH_CHANNELS);
        make();
    }
    ~Patch() override {
        fdh_destroy(player);
        fdh_close(file);
    }

protected:
    const char *getLabel() const override { return FDH_LABEL; }
    const char *getMaker() const override { return FDH_MAKER; }
    const char *getLicense() const override { return FDH_LICENCE_TEXT; }
    uint32_t getVersion() const override { return d_version(0, 1, 0); }
    int64_t getUniqueId() const override { return FDH_UNIQUE_ID; }

    void initParameter(uint32_t index, Parameter &parameter) override {
        if (index == LOST || (int)index > count()) {
            parameter.name = "lost events", parameter.symbol = "lost";
            parameter.hints = kParameterIsOutput, parameter.ranges = ParameterRanges(0.0f, 0.0f, 1e6f);
            return;
        }
        int n = (int)index - 1;
        const fdh_control &c = control(n);
        std::string name = fdh_control_name(file, number(n)), unit = fdh_control_unit(file, number(n));
        parameter.hints = kParameterIsAutomatable;
        parameter.name = (c.is_logarithmic ? name + ", log10" : name).c_str();
        parameter.symbol = ("p" + std::to_string(index)).c_str();
        parameter.unit = unit.c_str();
        parameter.ranges = ParameterRanges(values[index], (float)shown(n, c.low), (float)shown(n, c.high));
    }
    float getParameterValue(uint32_t index) const override {
        return index != LOST ? values[index] : player ? (float)fdh_lost(player) : 0.0f;
    }
    void setParameterValue(uint32_t index, float value) override {
        if (index == LOST || (int)index > count()) return;
        values[index] = value;
        if (player) send((int)index - 1);
    }
    void activate() override {
        if (!player) return;
        fdh_reset(player);
        for (int n = 0; n < count(); n++) send(n);
    }
    void sampleRateChanged(double) override { make(); }

    void run(const float **, float **outputs, uint32_t frames, const MidiEvent *events, uint32_t event_count) override {
        uint32_t done = 0;
        for (uint32_t n = 0; n < event_count; n++) {
            render(outputs, done, std::min(events[n].frame, frames));
            uint8_t message[3] = {0};
            if (events[n].size > 3 || !player) continue;
            std::memcpy(message, events[n].data, events[n].size);
            fdh_midi(player, file, message);
        }
        render(outputs, done, frames);
    }

private:
    fdh_file *file;
    fdh_player *player;
    std::vector<float> values, interleaved;

    static uint32_t count_parameters(const fdh_file *) { return FDH_PARAMETERS + 1; }
    int count() const { return file && !file->fault[0] ? FDH_PARAMETERS : 0; }
    int number(int index) const { /* of the controls that are parameters: the wheel is MIDI's */
        int n = 0;
        for (;; n++)
            if (file->about_controls[n].kind != FDH_WHEEL && index-- == 0) return n;
    }
    const fdh_control &control(int index) const { return file->about_controls[number(index)]; }
    double shown(int index, double value) const { return control(index).is_logarithmic ? std::log10(value) : value; }

    void send(int index) {
        const fdh_control &c = control(index);
        double value = values[1 + index];
        bool is_home = (float)value == (float)shown(index, c.home);
        fdh_set(player, number(index), is_home ? c.home : c.is_logarithmic ? std::pow(10.0, value) : value);
    }
    void make() {
        char fault[FDH_FAULT] = "there is no memory";
        fdh_destroy(player);
        player = file ? fdh_create(file, getSampleRate(), fault) : nullptr;
        if (!player) d_stderr2("fdh: %s", fault);
        else activate();
    }
    void render(float **outputs, uint32_t &done, uint32_t end) {
        while (done < end) {
            uint32_t size = std::min(AT_ONCE, end - done);
            if (player) fdh_process(player, interleaved.data(), (int)size);
            for (uint32_t c = 0; c < FDH_CHANNELS; c++)
                for (uint32_t i = 0; i < size; i++) outputs[c][done + i] = player ? interleaved[i * FDH_CHANNELS + c] : 0.0f;
            done += size;
        }
    }
    DISTRHO_DECLARE_NON_COPYABLE_WITH_LEAK_DETECTOR(Patch)
};

Plugin *createPlugin() { return new Patch(fdh_open(find_data().c_str())); }

END_NAMESPACE_DISTRHO
