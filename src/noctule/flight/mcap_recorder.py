"""Writes an MCAP file that any Foxglove tool opens.

Everything is written in the order in which it was handed in, by one thread of the writer's own, so the loop
never waits for the encoder or the disk and the same flight gives the same file. The file grows by whole
records only (no seeking back), so what a killed process or a full disk leaves behind can be read.
"""

from __future__ import annotations

import os
import queue
import threading
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import foxglove
from foxglove.mcap import MCAPCompression, MCAPWriteOptions

from noctule.errors import NoctuleError
from noctule.flight import codec

_QUEUE = 64  # messages under way; a picture that waits is 1.2 MB
_FLUSH_EVERY = 1.0  # [s] of flight


class RecordingError(NoctuleError):
    """The recording cannot be written any further; what was written so far can be read."""


class _AppendOnlyFile:
    """What the MCAP library writes to: after the first failure it keeps whole records and takes no more."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("wb", buffering=0)
        self._size = 0
        self.error: OSError | None = None

    def write(self, data: bytes | bytearray) -> int:
        if self.error is None:
            try:
                self._write_all(memoryview(data))
            except OSError as error:
                self.error = error
        return len(data)

    def _write_all(self, data: memoryview) -> None:
        done = 0
        try:
            while done < len(data):
                done += self._file.write(data[done:])
        except OSError:
            self._cut_to_size()
            raise
        self._size += len(data)

    def _cut_to_size(self) -> None:
        # A record written in part would be read as noise; a device that cannot be cut is left as it is.
        try:
            os.ftruncate(self._file.fileno(), self._size)
            self._file.seek(self._size)
        except OSError:
            pass

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        # Only ever asked where it is, because the writer is told not to seek.
        return self._size

    def flush(self) -> None:
        """Nothing is held back."""

    def close(self) -> None:
        self._file.close()


class McapRecorder:
    """Writes messages to one file, in a thread of its own; a context manager.

    Raises
    ------
    RecordingError
        By all that writes and by `close`, once the disk refuses; the file is then cut to whole records.
    """

    def __init__(self, path: Path, profile: str, compression: MCAPCompression | None = None) -> None:
        self.path = path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = _AppendOnlyFile(path)
        except OSError as error:
            raise RecordingError(
                f"recording {path}: cannot be written ({error.strerror}); name another folder with --out"
            ) from error
        # A context of its own: several recordings in one process do not see each other's messages.
        self._context = foxglove.Context()
        self._writer = foxglove.open_mcap(
            self._file,
            context=self._context,
            writer_options=MCAPWriteOptions(
                compression=compression, disable_seeking=True, compression_threads=0, profile=profile
            ),
        )
        self._next_flush: float | None = None
        self._failure: Exception | None = None
        self._closed = False
        self._jobs: queue.Queue[Callable[[], None] | None] = queue.Queue(_QUEUE)
        self._thread = threading.Thread(target=self._work, name="noctule-recorder", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        """Begin."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close; a flight that already failed keeps its own error."""
        try:
            self.close()
        except RecordingError:
            if error is None:
                raise

    @property
    def failed(self) -> bool:
        """Whether the disk has refused; nothing more is written then."""
        return self._file.error is not None or self._failure is not None

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            try:
                job()
            except Exception as error:
                self._failure = self._failure or error

    def _check(self) -> None:
        if self._file.error is not None:
            raise RecordingError(
                f"recording {self.path}: {self._file.error.strerror}; what was flown until then can be read, "
                "free some space or name another folder with --out"
            ) from self._file.error
        if self._failure is not None:
            raise RecordingError(
                f"recording {self.path}: a message could not be written ({self._failure}); "
                "what was flown until then can be read, please report this fault"
            ) from self._failure

    def _channel(self, message: Any) -> foxglove.Channel:
        """Return the channel of one of Noctule's own messages (its protobuf class)."""
        described = message.DESCRIPTOR
        return foxglove.Channel(
            f"/{described.name.lower()}",
            schema=foxglove.Schema(
                name=described.full_name, encoding="protobuf", data=codec.file_schema(described.file)
            ),
            message_encoding="protobuf",
            context=self._context,
        )

    def _flush_each_second(self, stamp: float) -> None:
        if self._next_flush is None:
            self._next_flush = stamp + _FLUSH_EVERY
        elif stamp >= self._next_flush:
            self._next_flush += _FLUSH_EVERY
            self.flush()

    def note(self, name: str, values: dict[str, str]) -> None:
        """Write named strings (the mission, versions, the summary)."""
        self._check()
        self._jobs.put(lambda: self._writer.write_metadata(name, values))

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Write a whole file into the recording."""
        self._check()
        self._jobs.put(
            lambda: self._writer.attach(
                log_time=0, create_time=0, name=name, media_type=media_type, data=data
            )
        )

    def flush(self) -> None:
        """Have all that was handed in so far written; returns before it is."""
        self._jobs.put(self._writer.flush)

    def close(self) -> None:
        """Write what is left and close the file; idempotent. Raises RecordingError."""
        if not self._closed:
            self._closed = True
            self._jobs.put(None)
            self._thread.join()
            try:
                self._writer.close()
            finally:
                self._file.close()
        self._check()
