"""Arguments of the methods of plants and laws. They are native; their types are in `arguments.pyi`."""

from .native import native as _native

Interval = _native().Interval
Sample = _native().Sample
Setup = _native().Setup
