"""Descriptions of plug-ins in bundles of LV2, in Turtle: ports, names and ranges."""

from collections.abc import Iterable
from urllib.parse import quote

from engine.export.plugin_data import PluginData
from engine.export.row_recorder import Slider
from engine.export.table_sliders import TableSlider

PREFIXES = {
    "lv2": "http://lv2plug.in/ns/lv2core#",
    "atom": "http://lv2plug.in/ns/ext/atom#",
    "midi": "http://lv2plug.in/ns/ext/midi#",
    "urid": "http://lv2plug.in/ns/ext/urid#",
    "log": "http://lv2plug.in/ns/ext/log#",
    "pprops": "http://lv2plug.in/ns/ext/port-props#",
    "units": "http://lv2plug.in/ns/extensions/units#",
    "doap": "http://usefulinc.com/ns/doap#",
    "foaf": "http://xmlns.com/foaf/0.1/",
    "rdfs": "http://www.w3.org/2000/01/rdf-schema#",
}
MIDI_PORT = (
    "a lv2:InputPort, atom:AtomPort ; atom:bufferType atom:Sequence ; atom:supports midi:MidiEvent ;"
    ' lv2:designation lv2:control ; lv2:symbol "midi" ; lv2:name "MIDI"'
)


def uri_of(name: str) -> str:
    """Return the address of a plug-in."""
    return f"urn:fdh-engine:{name}"


def manifest_of(name: str, binary: str) -> str:
    """Return the file `manifest.ttl` of a bundle."""
    kinds = "lv2:Plugin, lv2:InstrumentPlugin"
    return (
        f"{_prefixes('lv2', 'rdfs')}<{uri_of(name)}> a {kinds} ; lv2:binary <{binary}> ; rdfs:seeAlso <patch.ttl> .\n"
    )


def description_of(name: str, data: PluginData) -> str:
    """Return the file `patch.ttl` of a bundle."""
    title, author, licence = data.title, data.author, data.licence
    lines = [f"<{uri_of(name)}> a lv2:Plugin, lv2:InstrumentPlugin", f"doap:name {_text(title)}"]
    lines += [
        "lv2:minorVersion 0",
        "lv2:microVersion 0",
        "lv2:requiredFeature urid:map",
        "lv2:optionalFeature lv2:hardRTCapable, log:log",
    ]
    project = f"a doap:Project ; doap:name {_text(title)} ; doap:maintainer [ foaf:name {_text(author)} ]"
    lines += [f"lv2:project [ {project} ]"] * bool(author)
    lines += [f"rdfs:comment {_text(f'Licence: {licence}')}"] * bool(licence)
    lines += [f"doap:license <urn:licence:{quote(licence)}>"] * bool(licence)
    ports = " ,\n    ".join(f"[ lv2:index {n} ; {port} ]" for n, port in enumerate(_ports(data)))
    return _prefixes(*PREFIXES) + " ;\n  ".join([*lines, f"lv2:port {ports}"]) + " .\n"


def _ports(data: PluginData) -> Iterable[str]:
    """Yield the ports, in the order of `connect_port` in C."""
    yield MIDI_PORT
    for n in range(1, data.channels + 1):
        yield f'a lv2:OutputPort, lv2:AudioPort ; lv2:symbol "out{n}" ; lv2:name "Out {n}"'
    of_output = "a lv2:OutputPort, lv2:ControlPort ; lv2:portProperty lv2:integer"
    latency = "lv2:designation lv2:latency ; lv2:portProperty lv2:reportsLatency, pprops:notOnGUI"
    yield f'{of_output} ; {latency} ; lv2:symbol "latency" ; lv2:name "Latency" ; units:unit units:frame'
    yield f'{of_output} ; lv2:symbol "lost" ; lv2:name "Lost events" ; lv2:minimum 0 ; lv2:maximum 1000000'
    for n, control in enumerate(data.controls, 1):
        low, high, home, is_logarithmic = _range_of(control)
        port = f'a lv2:InputPort, lv2:ControlPort ; lv2:symbol "p{n}" ; lv2:name {_text(control.label or control.path)}'
        port += f" ; lv2:default {home:.9e} ; lv2:minimum {low:.9e} ; lv2:maximum {high:.9e}"
        port += " ; lv2:portProperty pprops:logarithmic" * is_logarithmic
        if control.unit:
            shown = _text(f"%g {control.unit}")
            symbol = _text(control.unit)
            port += (
                f" ; units:unit [ a units:Unit ; rdfs:label {symbol} ; units:symbol {symbol} ; units:render {shown} ]"
            )
        yield port


def _range_of(control: Slider | TableSlider) -> tuple[float, float, float, bool]:
    if isinstance(control, Slider):
        return control.low, control.high, control.value, control.is_logarithmic
    return control.values[0], control.values[-1], control.values[control.home], True


def _prefixes(*names: str) -> str:
    return "".join(f"@prefix {name}: <{PREFIXES[name]}> .\n" for name in names)


def _text(text: str) -> str:
    """Return a text in quotes."""
    marks = {"\\": "\\\\", '"': '\\"', "\n": "\\n", "\r": "\\r", "\t": "\\t"}
    return f'"{"".join(marks.get(one, one if one >= " " else "") for one in text)}"'
