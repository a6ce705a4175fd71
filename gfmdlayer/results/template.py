"""Files of one layout, made from the bytes of one of them.

HDF5 needs milliseconds to lay out a small file of many variables, and the cases of a sweep have files of one
layout. So HDF5 lays out one, the template, and the others are its bytes with other values in their places.
HDF5 tells the places of variables. Those of attributes are found by marks, values that are nowhere else in
the template.

Five structures of the HDF5 File Format Specification (version 3.0) are written here, in the form of its first
versions, which has no checksums of its own: the length of a variable (IV.A.2.b), the place of its values
(IV.A.2.i, contiguous), a text as length, collection and index, the collections of texts (III.E), and the end
of the file (II.A).
"""

from __future__ import annotations

import io
import math
import random
import struct
from collections.abc import Callable, Iterable, Mapping
from functools import cached_property
from typing import Any
from weakref import WeakSet

import h5py
import numpy as np
from numpy.typing import NDArray

from gfmdlayer.arrays import Attribute
from gfmdlayer.results.netcdf import set_attributes

MARKED = 0x5AC391E7B400  # from here on, lengths are marks of variables into which no values are written
_TEXT = 16  # bytes of the mark of a text
_NONE = 2**64 - 1  # address of nothing
_NULL = bytes(16)  # the reference to an empty text
_LEAST_COLLECTION = 4096  # bytes
_ODD = "surrogateescape"  # bytes of names of files that are no text, as h5py writes them

_made: WeakSet[Template] = WeakSet()  # in this process


def template_of(file: bytes) -> Template | None:
    """Return the template of this process that a file was made from."""
    return next((template for template in list(_made) if template.made(file)), None)


class Template:
    """The bytes of a file, with the places of its attributes and of the values of its variables.

    Parameters
    ----------
    lay_out : callable
        Creates the variables in an empty file. Those that grow are contiguous, and of different
        lengths from `MARKED` on.
    grows : iterable of str
        Variables whose length differs between the files.
    fixed : iterable of str
        Variables of numbers or a text whose values differ.
    attributes : mapping
        Attributes as the files have them: texts and numbers by their types, arrays by type and shape.
    """

    def __init__(
        self,
        lay_out: Callable[[h5py.File], None],
        grows: Iterable[str],
        fixed: Iterable[str],
        attributes: Mapping[str, Attribute],
    ) -> None:
        marks = {name: _mark(name, value) for name, value in attributes.items()}
        memory = io.BytesIO()
        with h5py.File(memory, "w", libver="earliest") as h5:
            lay_out(h5)
            set_attributes(h5, marks)
            words = {name: _mark(f"/{name}", "") for name in fixed if h5[name].dtype.kind == "O"}
            for name in fixed:
                h5[name][...] = words.get(name, 0)
        self._bytes = bytearray(memory.getvalue())
        with h5py.File(memory, "r") as h5:
            self.names, self.noted = tuple(h5), tuple(h5.attrs)
            self._fixed = {name: (h5[name].id.get_offset(), h5[name].dtype, h5[name].shape) for name in fixed}
            self._empty = {name: np.empty(h5[name].shape) for name in h5 if 0 in h5[name].shape}
            self._growing = {name: (*self._length_and_place(h5[name]), h5[name].dtype) for name in grows}
        for name, mark in words.items():
            self._fixed[name] = self._reference(mark), None, ()
        self._attributes = {name: self._place(mark) for name, mark in marks.items()}
        size = len(self._bytes)
        self._end = self._only(struct.pack("<QQQQ", 0, _NONE, size, _NONE)) + 16
        _made.add(self)

    def filled(self, values: Mapping[str, NDArray[Any]], attributes: Mapping[str, Attribute]) -> bytearray:
        """Return the file of other values, by the names of the variables, and of attributes."""
        file, texts = self._bytes.copy(), list[tuple[int, str]]()
        held = ((self._attributes[name], value) for name, value in attributes.items())
        for (place, dtype, _), value in (*held, *((at, values[name]) for name, at in self._fixed.items())):
            if dtype is None:
                texts.append((place, str(value)))
            else:
                known = np.asarray(value, dtype)
                file[place : place + known.nbytes] = known.tobytes()
        end, columns = len(file), []
        for name, (length, place, dtype) in self._growing.items():
            column = np.ascontiguousarray(values[name], dtype)
            struct.pack_into("<QQ", file, length, len(column), len(column))
            struct.pack_into("<QQ", file, place, end if column.size else _NONE, column.nbytes)
            columns.append(column.data)
            end += column.nbytes
        file += b"".join(columns)
        file += _collected(file, texts)
        struct.pack_into("<Q", file, self._end, len(file))
        return file

    @cached_property
    def _constant(self) -> list[slice]:
        """The stretches that all files have in common."""
        spans = [(self._end, 8)]
        for place, dtype, shape in (*self._attributes.values(), *self._fixed.values()):
            spans.append((place, _TEXT if dtype is None else dtype.itemsize * math.prod(shape)))
        for length, place, _ in self._growing.values():
            spans += [(length, 16), (place, 16)]
        edges = [
            0,
            *(edge for place, size in sorted(spans) for edge in (place, place + size)),
            len(self._bytes),
        ]
        return [slice(*edges[i : i + 2]) for i in range(0, len(edges), 2)]

    def made(self, file: bytes) -> bool:
        """Whether a file was made from this template, and nothing but its values can differ."""
        return all(file[part] == self._bytes[part] for part in self._constant)

    def value(self, file: bytes, name: str) -> Any:
        """Return an attribute of a file, text, number or array."""
        return self._held(file, *self._attributes[name])

    def values(self, file: bytes, name: str) -> NDArray[Any]:
        """Return the values of a variable in a file."""
        if name in self._fixed:
            return np.asarray(self._held(file, *self._fixed[name]))
        if name in self._empty:
            return self._empty[name]
        length, place, dtype = self._growing[name]
        (count,), (address,) = struct.unpack_from("<Q", file, length), struct.unpack_from("<Q", file, place)
        return np.frombuffer(file, dtype, count, address if count else 0)

    def _held(self, file: bytes, place: int, dtype: np.dtype[Any] | None, shape: tuple[int, ...]) -> Any:
        if dtype is not None:
            return np.frombuffer(file, dtype, math.prod(shape), place).reshape(shape)[()]
        size, address, index = struct.unpack_from("<IQI", file, place)
        at = address + 16
        for _ in range(index - 1):
            at += 16 + -(-struct.unpack_from("<Q", file, at + 8)[0] // 8) * 8
        return file[at + 16 : at + 16 + size].decode(errors=_ODD)

    # Places in the bytes.

    def _only(self, mark: bytes) -> int:
        """Return the place of bytes that are there once."""
        place = self._bytes.index(mark)
        assert self._bytes.find(mark, place + 1) < 0
        return place

    def _place(self, mark: Any) -> tuple[int, np.dtype[Any] | None, tuple[int, ...]]:
        """Return the place of an attribute, its type, none of a text, and its shape."""
        if isinstance(mark, str):
            return self._reference(mark), None, ()
        held = np.asarray(mark)
        return self._only(held.tobytes()) if held.size else 0, held.dtype, held.shape

    def _reference(self, mark: str) -> int:
        """Return the place of the reference to a text, whose mark is removed."""
        text = self._only(mark.encode())
        self._bytes[text : text + _TEXT] = bytes(_TEXT)
        index, _, _, size = struct.unpack_from("<HHIQ", self._bytes, text - 16)
        return self._only(struct.pack("<IQI", size, self._bytes.rindex(b"GCOL", 0, text), index))

    def _length_and_place(self, variable: h5py.Dataset) -> tuple[int, int]:
        """Return the places of the length of a variable, and of the address and size of its values."""
        length, size = len(variable), variable.dtype.itemsize
        of_length = struct.pack("<QQ", length, length)  # now, and at most
        of_values = struct.pack("<BBQQ", 3, 1, _NONE, length * size)
        return self._only(of_length), self._only(of_values) + 2


def _mark(name: str, like: Attribute) -> Any:
    """Return a value of the same type and shape that is nowhere else."""
    source = random.Random(name)
    if isinstance(like, str):
        return source.randbytes(_TEXT // 2).hex()
    if isinstance(like, np.ndarray):
        return np.frombuffer(source.randbytes(like.nbytes), like.dtype).reshape(like.shape)
    return source.getrandbits(62) if isinstance(like, int) else source.random()


def _collected(file: bytearray, texts: Iterable[tuple[int, str]]) -> bytes:
    """Return the collection of texts that follows the file, after setting the references to them."""
    parts, address = [], len(file)
    for index, (place, text) in enumerate(texts, start=1):
        held = text.encode(errors=_ODD)
        reference = struct.pack("<IQI", len(held), address, index) if held else _NULL
        file[place : place + len(reference)] = reference
        parts.append(struct.pack("<HHIQ", index, 1, 0, len(held)) + held + bytes(-len(held) % 8))
    contents = b"".join(parts)
    # Behind the texts, object 0 is the space that is left.
    left = max(16, _LEAST_COLLECTION - 16 - len(contents))
    size = 16 + len(contents) + left
    return (
        struct.pack("<4sB3xQ", b"GCOL", 1, size)
        + contents
        + struct.pack("<HHIQ", 0, 0, 0, left).ljust(left, b"\0")
    )
