"""How this package compiles: once a machine, kept on disk, results the same on every processor."""

import numba


def compiled(function):
    """The function, compiled by numba at its first call.

    The code is kept beside the source, or else in the user's cache folder, or in NUMBA_CACHE_DIR. Where none of them
    can be written, it is compiled anew in every process. numba notices a change of the file that holds the function,
    not of others: functions that call each other compiled belong into one file.
    """
    try:
        return numba.njit(cache=True, error_model="numpy")(function)
    except RuntimeError:  # no place to keep it
        return numba.njit(error_model="numpy")(function)
