"""The functions that SUMO is called by; the only file that imports libsumo."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, Protocol

from platoontraffic.errors import MissingError

# When libsumo finds a pyarrow of another version it prints a warning on stdout, which is for results, unless this
# variable says "quiet"; `doctor` reports the mismatch. traci reads the same variable, so it is put back.
_before = os.environ.get("LIBSUMO_AS_TRACI")
os.environ["LIBSUMO_AS_TRACI"] = "quiet"
try:
    import libsumo
    from libsumo import _libsumo
except ModuleNotFoundError:
    raise
except ImportError as error:  # the system lacks a library that it is linked with
    packages = "libgl1 libx11-6 libxext6 libxrender1 libatomic1"
    raise MissingError(
        f"SUMO's library does not load: {error}; on Debian and Ubuntu: apt install {packages}"
    ) from error

os.environ.pop("LIBSUMO_AS_TRACI")
if _before is not None:
    os.environ["LIBSUMO_AS_TRACI"] = _before

__all__ = ["Client", "direct", "libsumo"]


@lru_cache  # the same few functions in every step
def direct(function: Callable) -> Callable:
    """The compiled function that one of libsumo's calls, where it does no more: it takes half the time.

    function: of a `Client`, as `sumo.vehicle.getSpeed`; a remote one's stays as it is. All arguments are to be given.
    """
    name = getattr(function, "__qualname__", "").replace(".", "_")
    return getattr(_libsumo, name, function)


class Client(Protocol):
    """An object with the functions of the module libsumo: that module (SUMO in this process) or a `RemoteSumo`.

    Only what the package uses is listed. Domains (`vehicle`, `lane`, ...) have libsumo's signatures. A remote SUMO has
    them after `start` only, so users keep the client and not its domains.
    """

    TraCIException: type[Exception]  # SUMO refuses a call
    FatalTraCIError: type[Exception]  # SUMO is gone
    constants: Any
    edge: Any
    lane: Any
    person: Any
    route: Any
    simulation: Any
    trafficlight: Any
    vehicle: Any
    vehicletype: Any

    def start(self, options: Sequence[str]) -> Any:
        """Start SUMO; options: its command line, beginning with the program's name.

        raises: TraCIException
        """

    def simulationStep(self, until: float = 0.0) -> Any:
        """One step, or all steps to a time of SUMO's clock [s]."""

    def close(self) -> None: ...
