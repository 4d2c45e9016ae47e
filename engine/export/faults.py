"""Why a scene cannot leave Python."""


class CannotExport(ValueError):
    """A scene that cannot leave Python, with the reason."""
