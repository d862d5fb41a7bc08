"""A client of Dask that unpickles nothing: whatever comes back from a scheduler and its workers is text and numbers.

Dask's client unpickles results, errors, tracebacks, types, warnings, and any part of a message that says so, whatever its
`deserializers` are. So a worker could run code in the campaign's process. The transports here, which only these clients have, read
each message as msgpack, and all bytes in it as text: nothing is left that could be unpickled. Importing this module imports Dask.
"""

import pickletools
import struct
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from ssl import SSLError
from typing import Any, Final

import distributed
import msgpack
from distributed.comm import CommClosedError, registry, tcp
from distributed.comm.addressing import parse_address
from distributed.protocol import pickle
from distributed.protocol.compression import decompress
from distributed.protocol.utils import msgpack_opts, unpack_frames
from tornado.iostream import StreamClosedError

_SCHEME: Final = "vastflow-"
_TEXT: Final = "latin-1"
"""Has a character for each byte."""


class _Plain:
    """Reads messages without unpickling; for the rest see `distributed.comm.tcp.TCP`."""

    stream: Any
    abort: Callable[[], None]

    async def read(self, deserializers: object = None) -> Any:
        """Return the next message.

        Raises:
            CommClosedError: the connection ended, or what came is no message.
        """
        if self.stream is None:
            raise CommClosedError
        try:
            (size,) = struct.unpack("Q", await self.stream.read_bytes(8))
            frames, sizes = unpack_frames(await tcp.read_bytes_rw(self.stream, size), partial=True)
            return plain_message([*frames, *[await tcp.read_bytes_rw(self.stream, each) for each in sizes]])
        except (StreamClosedError, SSLError) as error:
            self.stream, self._closed = None, True
            tcp.convert_stream_closed_error(self, error)
        except BaseException as error:
            self.abort()
            if isinstance(error, Exception):
                raise CommClosedError(f"expected a message of Dask's, got {error}") from None
            raise


def _backend(comm: Any, connector: Any, backend: Any) -> Any:
    """Return a transport of Dask's that reads plainly."""
    plain = type("Plain", (_Plain, comm), {})
    connects = type("PlainConnector", (connector,), {"comm_class": plain})
    return type("PlainBackend", (backend,), {"_connector_class": connects})()


registry.backends[f"{_SCHEME}tcp"] = _backend(tcp.TCP, tcp.TCPConnector, tcp.TCPBackend)
registry.backends[f"{_SCHEME}tls"] = _backend(tcp.TLS, tcp.TLSConnector, tcp.TLSBackend)


def plain_client(address: str, security: Any, **options: Any) -> Any:
    """Return a `distributed.Client` of a scheduler that reads by these transports, and asks no worker itself.

    Raises:
        ValueError: the address is neither `tcp://…` nor `tls://…`.
    """
    scheme, place = parse_address(address)
    if f"{_SCHEME}{scheme}" not in registry.backends:
        raise ValueError(f"expected tcp://HOST:PORT or tls://HOST:PORT, got {address!r}")
    options = {"set_as_default": False, "direct_to_workers": False, **options}
    return distributed.Client(f"{_SCHEME}{scheme}://{place}", security=security, **options)


def call_workers(client: Any, function: Any) -> dict[str, Any]:
    """Call a function on each worker; return its answer, or a pickled error as text."""
    message = {"op": "run", "function": pickle.dumps(function), "wait": True}
    return dict(client.sync(client.scheduler.broadcast, msg=message, on_error="return_pickle"))


def plain_message(frames: Sequence[Any]) -> Any:
    """Return a message of Dask's protocol without unpickling; bytes, also those in a part of its own, are text."""

    def plain(value: Any) -> Any:
        return str(value, _TEXT) if isinstance(value, bytes | bytearray | memoryview) else value

    def mapping(pairs: dict[Any, Any]) -> Any:
        if (offset := pairs.get("__Serialized__") or pairs.get("__Pickled__")) is not None:
            header = msgpack.loads(frames[offset], use_list=False, **msgpack_opts)
            parts = frames[offset + 1 : offset + 1 + header["num-sub-frames"]]
            return plain(b"".join(decompress(header, parts) if "compression" in header else parts))
        if "__Set__" in pairs:
            return set(pairs["as-list"])
        return {
            name: plain(value) for name, value in pairs.items() if name != "type"
        }  # a result's: pickled, and unused

    def sequence(values: Iterable[Any]) -> tuple[Any, ...]:
        return tuple(map(plain, values))

    hooks = {"object_hook": mapping, "list_hook": sequence}
    return plain(msgpack.loads(frames[0], use_list=False, **hooks, **msgpack_opts))


def pickled_error(text: str) -> tuple[str, str]:
    """Return the class name of a pickled exception, and its longest string, by opcodes alone, which may claim anything."""
    names: list[str] = []
    strings = [""]
    with suppress(ValueError):
        for opcode, argument, _ in pickletools.genops(text.encode(_TEXT)):
            strings += [argument] if isinstance(argument, str) else []
            if opcode.name == "STACK_GLOBAL":
                module, name = ["", *strings][-2:]
                if module.startswith("tblib"):  # which Dask wraps exceptions in
                    strings = [""]
                else:
                    names.append(name)
    return names[0] if names else "Exception", max(strings, key=len)[:500]
