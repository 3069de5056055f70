"""The tree of exceptions, each with the exit code of the command line.

    DemBridgeError
    ├── UsageError           wrong use: unknown name, keyword or setting            exit 2
    ├── SceneError           a scene or scene file that cannot be accepted          exit 2
    ├── UnsupportedScene     the scene is sound, but not for this backend           NOT_RUN
    ├── BackendUnavailable   the backend's engine is missing on this machine        NOT_RUN
    ├── NotAsymptotic        results from which no extrapolation follows            exit 2
    └── RunBroken            a run that started and failed                          exit 3

Every message is one line that says what was asked, what was found, what is allowed and what to do.
"""

from __future__ import annotations


class DemBridgeError(Exception):
    """Base of all errors that dem_bridge raises on purpose."""

    exit_code = 2


class UsageError(DemBridgeError, ValueError):
    """A name, keyword or setting that does not exist or does not fit."""


class SceneError(DemBridgeError, ValueError):
    """A scene that cannot be accepted; ``key`` and ``where`` say which entry of which file.

    >>> print(SceneError("chain.mass[1]", found=-0.01, allowed="a number > 0 (kg)", where="bad.toml"))
    bad.toml: chain.mass[1] = -0.01; allowed: a number > 0 (kg)
    """

    def __init__(
        self,
        key: str,
        *,
        allowed: str,
        found: object = None,
        problem: str = "",
        advice: str = "",
        where: str = "scene",
    ) -> None:
        self.key, self.found, self.problem, self.allowed = key, found, problem, allowed
        self.advice, self.where = advice, where
        what = problem or f"= {found!r}"
        parts = [f"{where}: {key} {what}" if key else f"{where}: {what}", f"allowed: {allowed}"]
        super().__init__("; ".join(parts + ([advice] if advice else [])))

    def at(self, where: str, key: str) -> SceneError:
        """The same error, seen from the file and key that a person wrote."""
        return SceneError(
            key, allowed=self.allowed, found=self.found, problem=self.problem, advice=self.advice, where=where
        )


class UnsupportedScene(DemBridgeError):
    """A backend was asked for physics that it does not have."""


class BackendUnavailable(DemBridgeError):
    """A backend cannot run on this machine; the message says why and what to install."""


class NotAsymptotic(DemBridgeError, ValueError):
    """Resolutions that show no clean order of convergence: what would be extrapolated from them is refused."""


class RunBroken(DemBridgeError):
    """A run started and did not give a result; ``log`` holds the engine's own last words."""

    exit_code = 3

    def __init__(self, message: str, *, log: str = "") -> None:
        self.log = log
        super().__init__(message)
