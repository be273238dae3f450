"""The lidar package under this project's name, for where another package called `lidar` is installed too."""

from lidar import *  # noqa: F403
from lidar import __all__  # noqa: F401
