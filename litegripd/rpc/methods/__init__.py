"""The core's methods, group by group: what they take and do. Checks and documents follow them.

A further method is a further function with its row above it; a further group is a class, named here
and made by the service. What a slice adds is a `Feature`, named in `app/build.py`.
"""

from litegripd.rpc.methods.lease import LeaseMethods
from litegripd.rpc.methods.motion import MotionMethods
from litegripd.rpc.methods.reading import ReadingMethods
from litegripd.rpc.methods.settings import SettingsMethods

CORE: tuple[type, ...] = (ReadingMethods, LeaseMethods, MotionMethods, SettingsMethods)
"""In the order in which documents list their methods; those of features come behind them."""
