"""A host of LV2 plug-ins for tests, by the layouts of the standard (https://lv2plug.in)."""

import ctypes as c
import struct

import numpy as np


class Feature(c.Structure):
    _fields_ = [("uri", c.c_char_p), ("data", c.c_void_p)]


MAP = c.CFUNCTYPE(c.c_uint32, c.c_void_p, c.c_char_p)


class UridMap(c.Structure):
    _fields_ = [("handle", c.c_void_p), ("map", MAP)]


class Descriptor(c.Structure):
    _fields_ = [
        ("uri", c.c_char_p),
        ("instantiate", c.CFUNCTYPE(c.c_void_p, c.c_void_p, c.c_double, c.c_char_p, c.POINTER(c.POINTER(Feature)))),
        ("connect", c.CFUNCTYPE(None, c.c_void_p, c.c_uint32, c.c_void_p)),
        ("activate", c.CFUNCTYPE(None, c.c_void_p)),
        ("run", c.CFUNCTYPE(None, c.c_void_p, c.c_uint32)),
        ("deactivate", c.c_void_p),
        ("cleanup", c.CFUNCTYPE(None, c.c_void_p)),
        ("extension", c.c_void_p),
    ]


class Library(c.Structure):
    _fields_ = [
        *[("handle", c.c_void_p), ("size", c.c_uint32), ("cleanup", c.CFUNCTYPE(None, c.c_void_p))],
        ("get", c.CFUNCTYPE(c.POINTER(Descriptor), c.c_void_p, c.c_uint32)),
    ]


class Lv2Plugin:
    """An instance of the plug-in of a bundle. channels: of its output"""

    def __init__(self, bundle, binary, rate, channels):
        uris = ["", "http://lv2plug.in/ns/ext/midi#MidiEvent", "http://lv2plug.in/ns/ext/atom#Sequence"]

        def find(_, uri):
            if uri.decode() not in uris:
                uris.append(uri.decode())
            return uris.index(uri.decode())

        self._map = UridMap(None, MAP(find))
        self._feature = Feature(b"http://lv2plug.in/ns/ext/urid#map", c.addressof(self._map))
        self._features = (c.POINTER(Feature) * 2)(c.pointer(self._feature), None)
        self._library = c.CDLL(str(bundle / binary))
        self._library.lv2_lib_descriptor.restype = c.POINTER(Library)
        path = f"{bundle}/".encode()
        made = self._library.lv2_lib_descriptor(path, self._features)
        assert made and not made.contents.get(made.contents.handle, 1)
        self.descriptor = made.contents.get(made.contents.handle, 0).contents
        self.handle = self.descriptor.instantiate(c.byref(self.descriptor), rate, path, self._features)
        self.channels, self.controls = channels, {}
        assert self.handle
        self.descriptor.activate(self.handle)

    def control(self, port, value):
        """Set the value of a port, or get ready to read one."""
        if port not in self.controls:
            self.controls[port] = c.c_float(value)
            self.descriptor.connect(self.handle, port, c.addressof(self.controls[port]))
        self.controls[port].value = value

    def render(self, frames, events=(), blocks=(256,)):
        """Return so many frames, [frames, channels]. events: frame and bytes of MIDI, sorted"""
        out, done, turn = np.zeros((self.channels, frames), np.float32), 0, 0
        while done < frames:
            size = min(blocks[turn % len(blocks)], frames - done)
            turn += 1
            content = b""
            for frame, data in events:
                if done <= frame < done + size:
                    content += struct.pack("<qII", frame - done, len(data), 1) + bytes(data) + bytes(-len(data) % 8)
            sequence = struct.pack("<IIII", 8 + len(content), 2, 0, 0) + content
            room = c.create_string_buffer(sequence, len(sequence) + 8)
            self.descriptor.connect(self.handle, 0, c.addressof(room))
            for n in range(self.channels):
                self.descriptor.connect(self.handle, 1 + n, out[n, done:].ctypes.data)
            self.descriptor.run(self.handle, size)
            done += size
        return out.T

    def close(self):
        self.descriptor.cleanup(self.handle)
