"""The analysis package under this project's name, for where another package called `analysis` is installed too."""

from analysis import *  # noqa: F403
from analysis import __all__  # noqa: F401
