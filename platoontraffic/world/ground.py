from typing import Protocol


class Ground(Protocol): ...


class BareGround: ...
