"""A host of CLAP plug-ins for tests, by the layouts of the standard (https://github.com/free-audio/clap)."""

import ctypes as c
from typing import NamedTuple

import numpy as np

NOTE_ON, NOTE_OFF, CHOKE, NOTE_END, EXPRESSION, PARAM_VALUE, PARAM_MOD = range(7)
MIDI = 10
CONTINUE, SLEEP = 1, 4
VERSION = (c.c_uint32 * 3)(1, 1, 8)


class Header(c.Structure):
    _fields_ = [
        ("size", c.c_uint32),
        ("time", c.c_uint32),
        ("space", c.c_uint16),
        ("type", c.c_uint16),
        ("flags", c.c_uint32),
    ]


class NoteEvent(c.Structure):
    _fields_ = [
        *[("header", Header), ("note_id", c.c_int32), ("port", c.c_int16), ("channel", c.c_int16)],
        *[("key", c.c_int16), ("velocity", c.c_double)],
    ]


class ParamEvent(c.Structure):
    _fields_ = [
        *[("header", Header), ("param", c.c_uint32), ("cookie", c.c_void_p), ("note_id", c.c_int32)],
        *[("port", c.c_int16), ("channel", c.c_int16), ("key", c.c_int16), ("value", c.c_double)],
    ]


class MidiEvent(c.Structure):
    _fields_ = [("header", Header), ("port", c.c_uint16), ("data", c.c_uint8 * 3)]


SIZE_OF = c.CFUNCTYPE(c.c_uint32, c.c_void_p)
GET = c.CFUNCTYPE(c.c_void_p, c.c_void_p, c.c_uint32)
PUSH = c.CFUNCTYPE(c.c_bool, c.c_void_p, c.POINTER(NoteEvent))
STREAM = c.CFUNCTYPE(c.c_int64, c.c_void_p, c.c_void_p, c.c_uint64)
EXTENSION = c.CFUNCTYPE(c.c_void_p, c.c_void_p, c.c_char_p)
LOG = c.CFUNCTYPE(None, c.c_void_p, c.c_int32, c.c_char_p)
ASK = c.CFUNCTYPE(None, c.c_void_p)


class InputEvents(c.Structure):
    _fields_ = [("ctx", c.c_void_p), ("size", SIZE_OF), ("get", GET)]


class OutputEvents(c.Structure):
    _fields_ = [("ctx", c.c_void_p), ("push", PUSH)]


class Stream(c.Structure):
    _fields_ = [("ctx", c.c_void_p), ("move", STREAM)]


class Buffer(c.Structure):
    _fields_ = [
        *[("data32", c.POINTER(c.c_void_p)), ("data64", c.c_void_p), ("channels", c.c_uint32)],
        *[("latency", c.c_uint32), ("constant", c.c_uint64)],
    ]


class Process(c.Structure):
    _fields_ = [
        *[("steady", c.c_int64), ("frames", c.c_uint32), ("transport", c.c_void_p), ("inputs", c.c_void_p)],
        *[("outputs", c.POINTER(Buffer)), ("input_count", c.c_uint32), ("output_count", c.c_uint32)],
        *[("in_events", c.POINTER(InputEvents)), ("out_events", c.POINTER(OutputEvents))],
    ]


class Host(c.Structure):
    _fields_ = [
        *[("version", c.c_uint32 * 3), ("data", c.c_void_p)],
        *[(name, c.c_char_p) for name in ("name", "vendor", "url", "host_version")],
        *[("get_extension", EXTENSION), ("restart", ASK), ("process", ASK), ("callback", ASK)],
    ]


class Descriptor(c.Structure):
    _fields_ = [
        ("version", c.c_uint32 * 3),
        *[
            (n, c.c_char_p)
            for n in ("id", "name", "vendor", "url", "manual", "support", "plugin_version", "description")
        ],
        ("features", c.POINTER(c.c_char_p)),
    ]


def function(result, *arguments):
    return c.CFUNCTYPE(result, c.c_void_p, *arguments)


class PluginTable(c.Structure):
    _fields_ = [
        *[
            ("desc", c.POINTER(Descriptor)),
            ("data", c.c_void_p),
            ("init", function(c.c_bool)),
            ("destroy", function(None)),
        ],
        ("activate", function(c.c_bool, c.c_double, c.c_uint32, c.c_uint32)),
        *[
            ("deactivate", function(None)),
            ("start", function(c.c_bool)),
            ("stop", function(None)),
            ("reset", function(None)),
        ],
        ("process", function(c.c_int32, c.POINTER(Process))),
        ("get_extension", function(c.c_void_p, c.c_char_p)),
        ("on_main_thread", function(None)),
    ]


class Factory(c.Structure):
    _fields_ = [
        ("count", function(c.c_uint32)),
        ("descriptor", function(c.POINTER(Descriptor), c.c_uint32)),
        ("create", function(c.POINTER(PluginTable), c.POINTER(Host), c.c_char_p)),
    ]


class Entry(c.Structure):
    _fields_ = [
        *[("version", c.c_uint32 * 3), ("init", c.CFUNCTYPE(c.c_bool, c.c_char_p)), ("deinit", c.CFUNCTYPE(None))],
        ("get_factory", c.CFUNCTYPE(c.POINTER(Factory), c.c_char_p)),
    ]


class ParamInfo(c.Structure):
    _fields_ = [
        *[("id", c.c_uint32), ("flags", c.c_uint32), ("cookie", c.c_void_p), ("name", c.c_char * 256)],
        *[("module", c.c_char * 1024), ("low", c.c_double), ("high", c.c_double), ("default", c.c_double)],
    ]


class Params(c.Structure):
    _fields_ = [
        ("count", function(c.c_uint32)),
        ("get_info", function(c.c_bool, c.c_uint32, c.POINTER(ParamInfo))),
        ("get_value", function(c.c_bool, c.c_uint32, c.POINTER(c.c_double))),
        ("to_text", function(c.c_bool, c.c_uint32, c.c_double, c.c_char_p, c.c_uint32)),
        ("from_text", function(c.c_bool, c.c_uint32, c.c_char_p, c.POINTER(c.c_double))),
        ("flush", function(None, c.POINTER(InputEvents), c.POINTER(OutputEvents))),
    ]


class AudioPort(c.Structure):
    _fields_ = [
        *[("id", c.c_uint32), ("name", c.c_char * 256), ("flags", c.c_uint32), ("channels", c.c_uint32)],
        *[("kind", c.c_char_p), ("pair", c.c_uint32)],
    ]


class AudioPorts(c.Structure):
    _fields_ = [
        ("count", function(c.c_uint32, c.c_bool)),
        ("get", function(c.c_bool, c.c_uint32, c.c_bool, c.POINTER(AudioPort))),
    ]


class State(c.Structure):
    _fields_ = [("save", function(c.c_bool, c.POINTER(Stream))), ("load", function(c.c_bool, c.POINTER(Stream)))]


class Number(c.Structure):
    _fields_ = [("get", function(c.c_uint32))]


class HostLog(c.Structure):
    _fields_ = [("log", LOG)]


class Event(NamedTuple):
    """An event at a frame, counted from the beginning."""

    frame: int
    made: c.Structure


def note(frame, kind, key, velocity=64, note_id=-1):
    """A note; velocity: 1 to 127."""
    header = Header(c.sizeof(NoteEvent), 0, 0, kind, 0)
    return Event(frame, NoteEvent(header, note_id, 0, 0, key, velocity / 127.0))


def midi(frame, *data):
    return Event(frame, MidiEvent(Header(c.sizeof(MidiEvent), 0, 0, MIDI, 0), 0, (c.c_uint8 * 3)(*data)))


def parameter(frame, number, value, kind=PARAM_VALUE):
    return Event(frame, ParamEvent(Header(c.sizeof(ParamEvent), 0, 0, kind, 0), number, None, -1, -1, -1, -1, value))


class ClapLibrary:
    """A library that was loaded from a file."""

    def __init__(self, path):
        self.logged = []
        self._library = c.CDLL(str(path))
        self.entry = Entry.in_dll(self._library, "clap_entry")
        assert self.entry.init(str(path).encode())
        self.factory = self.entry.get_factory(b"clap.plugin-factory")
        self._log = HostLog(LOG(lambda host, severity, text: self.logged.append((severity, text.decode()))))
        extensions = {b"clap.log": c.addressof(self._log)}
        names = [b"test", b"", b"", b"1"]
        asks = [ASK(lambda host: None) for _ in range(3)]
        self.host = Host(VERSION, None, *names, EXTENSION(lambda host, name: extensions.get(name)), *asks)

    @property
    def descriptor(self):
        assert self.factory.contents.count(self.factory) == 1
        return self.factory.contents.descriptor(self.factory, 0).contents

    def plugin(self):
        """Return a new instance; None if it was refused."""
        made = self.factory.contents.create(self.factory, c.byref(self.host), self.descriptor.id)
        return ClapPlugin(self, made) if made else None

    def close(self):
        self.entry.deinit()


class ClapPlugin:
    """An instance of a plug-in."""

    def __init__(self, library, table):
        self.library, self._table = library, table
        self.ended = []  # notes whose end it said: frame, key, id
        assert self._call("init")
        port = AudioPort()
        ports = self.extension("clap.audio-ports", AudioPorts)
        assert ports.count(table, False) == 1 and ports.count(table, True) == 0 and ports.get(table, 0, False, port)
        self.channels = port.channels
        self.params = self.extension("clap.params", Params)

    def _call(self, name, *arguments):
        return getattr(self._table.contents, name)(self._table, *arguments)

    def extension(self, name, kind):
        found = self._call("get_extension", name.encode())
        return c.cast(found, c.POINTER(kind)).contents

    def activate(self, rate, most=4096):
        self.is_active = self._call("activate", rate, 1, most) and self._call("start")
        return self.is_active

    def deactivate(self):
        self._call("stop")
        self._call("deactivate")

    def reset(self):
        self._call("reset")

    def destroy(self):
        self._call("destroy")

    @property
    def latency(self):
        return self.extension("clap.latency", Number).get(self._table)

    def parameters(self):
        """Return what the plug-in says of its parameters, by name."""
        infos = [ParamInfo() for _ in range(self.params.count(self._table))]
        assert all(self.params.get_info(self._table, n, info) for n, info in enumerate(infos))
        return {info.name.decode(): info for info in infos}

    def value(self, number):
        value = c.c_double()
        assert self.params.get_value(self._table, number, value)
        return value.value

    def text(self, number, value):
        room = c.create_string_buffer(256)
        assert self.params.to_text(self._table, number, value, room, 256)
        return room.value.decode()

    def value_of(self, number, text):
        value = c.c_double()
        return value.value if self.params.from_text(self._table, number, text.encode(), value) else None

    def save(self):
        """Return the state."""
        kept = bytearray()

        def write(stream, data, size):
            count = min(size, 7)  # a host may take it in pieces
            kept.extend(c.string_at(data, count))
            return count

        stream = Stream(None, STREAM(write))
        assert self.extension("clap.state", State).save(self._table, stream)
        return bytes(kept)

    def load(self, state):
        """Set the state. Returns whether the plug-in took it."""
        rest = bytearray(state)

        def read(stream, data, size):
            count = min(size, len(rest), 11)
            c.memmove(data, bytes(rest[:count]), count)
            del rest[:count]
            return count

        return self.extension("clap.state", State).load(self._table, Stream(None, STREAM(read)))

    def render(self, frames, events=(), blocks=(256,)):
        """Return so many frames, [frames, channels], float32. blocks: their sizes, in turn"""
        out = np.zeros((self.channels, frames), np.float32)
        events, done, turn, self.answers = sorted(events, key=lambda e: e.frame), 0, 0, []
        while done < frames:
            size = min(blocks[turn % len(blocks)], frames - done)
            turn += 1
            due = [event for event in events if done <= event.frame < done + size]
            for event in due:
                event.made.header.time = event.frame - done
            self.answers.append(self._process(out, done, size, [event.made for event in due]))
            done += size
        return out.T

    def _process(self, out, done, size, due):
        addresses = (c.c_void_p * self.channels)(*(out[n, done:].ctypes.data for n in range(self.channels)))
        buffer = Buffer(c.cast(addresses, c.POINTER(c.c_void_p)), None, self.channels, 0, 0)

        def push(events, event):
            made = event.contents
            if made.header.type == NOTE_END:
                self.ended.append((done + made.header.time, made.key, made.note_id))
            return True

        given = InputEvents(None, SIZE_OF(lambda _: len(due)), GET(lambda _, n: c.addressof(due[n])))
        taken = OutputEvents(None, PUSH(push))
        block = Process(done, size, None, None, c.pointer(buffer), 0, 1, c.pointer(given), c.pointer(taken))
        return self._call("process", block)
