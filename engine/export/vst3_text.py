"""Descriptions of plug-ins of VST3, as DPF reads them when it compiles one."""

import json
import zlib

from engine.export.plugin_data import PluginData
from engine.provenance import ENGINE


def info_of(name: str, data: PluginData) -> str:
    """Return the file `DistrhoPluginInfo.h`. A host knows the plug-in by its address and by the number made of it."""
    address = f"urn:{ENGINE}:{name}"
    defined = {
        "DISTRHO_PLUGIN_BRAND": _text(ENGINE),
        "DISTRHO_PLUGIN_NAME": _text(data.title),
        "DISTRHO_PLUGIN_URI": _text(address),
        "DISTRHO_PLUGIN_NUM_INPUTS": 0,
        "DISTRHO_PLUGIN_NUM_OUTPUTS": data.channels,
        "DISTRHO_PLUGIN_IS_SYNTH": 1,
        "DISTRHO_PLUGIN_IS_RT_SAFE": 1,
        "DISTRHO_PLUGIN_WANT_MIDI_INPUT": 1,
        "DISTRHO_PLUGIN_VST3_CATEGORIES": _text("Instrument|Synth"),
        "FDH_PARAMETERS": len(data.controls),
        "FDH_CHANNELS": data.channels,
        "FDH_LABEL": _text(name),
        "FDH_MAKER": _text(data.author or ENGINE),
        "FDH_LICENCE_TEXT": _text(data.licence),
        "FDH_UNIQUE_ID": zlib.crc32(address.encode()),
    }
    return "".join(f"#define {key} {value}\n" for key, value in defined.items())


def _text(text: str) -> str:
    """Return a text as C has it."""
    return json.dumps("".join(one for one in text if one >= " "), ensure_ascii=False)
