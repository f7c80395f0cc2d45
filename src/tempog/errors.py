"""What can go wrong, as one tree.

TempogError
├── ConfigError         a setting that cannot work, or does not fit the data
├── ScanError           a scan or a scan log that cannot be used
│   └── ClockError      its time stamps make no usable time axis
├── ExtentError         a scan would make the map absurdly large (usually a corrupt pose)
├── TimeError           a moment that the map does not cover
│   ├── MomentError     what was given is no moment; also a ConfigError
│   └── EmptyWindowError   no scan falls into the period asked for
├── MapError            a saved map that cannot be read or written
├── WorldError          a world to simulate that cannot be, or whose file cannot be read
├── TruthError          the truth about a simulated log that cannot be read
├── MessageError        bytes that are no message of the type they should be
├── TransformError      no way from one frame to another, or not at that time
├── DatasetError        a public log that cannot be fetched, or is not the one it was
├── LinkError           a robot, a router or a master that cannot be reached
├── ExtraError          a package that only some of tempog needs is not installed
├── AnswerError         found objects that cannot be read, or not be judged
├── ClusterError        workers that cannot be reached, or that lost what they were given
└── ViewerError         a viewer of somebody else's that cannot be started

Every message says what was seen, what was wanted and what to do. The library raises these and never
prints; the command line shows the message alone, without a traceback.
"""


class TempogError(Exception):
    """Root of all errors that tempog raises on purpose."""


class ConfigError(TempogError, ValueError):
    """A setting that cannot work, or that does not fit the data it is used on."""


class ScanError(TempogError, ValueError):
    """A scan or a scan log that cannot be used."""


class ClockError(ScanError):
    """Time stamps that make no usable time axis."""


class ExtentError(TempogError, ValueError):
    """A scan would make the map larger than `GridConfig.max_cells`."""


class TimeError(TempogError, ValueError):
    """A moment that the map does not cover."""


class MomentError(TimeError, ConfigError):
    """Text or a value that is no moment, or a period that ends before it begins."""


class EmptyWindowError(TimeError):
    """No scan falls into the period asked for."""


class MapError(TempogError):
    """A saved map that cannot be read or written."""


class WorldError(TempogError, ValueError):
    """A world to simulate that cannot be, or whose file cannot be read."""


class TruthError(TempogError, ValueError):
    """The truth about a simulated log that cannot be read."""


class MessageError(TempogError, ValueError):
    """Bytes that are no ROS message of the type they should be, or a type that nobody has defined."""


class TransformError(TempogError, LookupError):
    """Frames that nothing connects, or a moment at which nothing does."""


class DatasetError(TempogError):
    """A public log that cannot be fetched, or is not the one it was."""


class LinkError(TempogError, ConnectionError):
    """A robot, a Zenoh router or a ROS master that cannot be reached."""


class ExtraError(TempogError, ImportError):
    """A package that only some of tempog needs, and that is not installed."""


class AnswerError(TempogError, ValueError):
    """A document of found objects that cannot be read, or that its truth cannot judge."""


class ClusterError(TempogError):
    """A cluster that cannot be reached or used, or that was lost in the middle of the work."""


class ViewerError(TempogError):
    """Somebody else's viewer that cannot be started, or that ends with an error."""
