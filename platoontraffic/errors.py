"""The two kinds of trouble the command line tells apart."""


class InputError(ValueError):
    """Something the user wrote is wrong: a file, an argument, a plug-in. Exit code 2.

    faults: one line each, `file:line: key: what is wrong; what is allowed`.
    """

    def __init__(self, *faults: str) -> None:
        self.faults = faults
        super().__init__("\n".join(faults))


class RunError(RuntimeError):
    """The run failed although its input was sound: SUMO died, the disk is full. Exit code 1."""
