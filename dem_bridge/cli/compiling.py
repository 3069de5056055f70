"""Say on the first call that kernels are compiled."""

from __future__ import annotations

import click


def announce_compiling(kernel: str = "dem_bridge.", *, silent: bool = False) -> None:
    """Print on stderr that kernels are compiled first; nothing where one is on disk whose name has ``kernel``."""
    from dem_bridge.foundation.kernel_folders import folders_to_read

    if not silent and not any(next(folder.glob(f"*{kernel}*"), None) for folder in folders_to_read()):
        click.echo("dem-bridge: kernels are compiled first, once on this machine: up to a minute", err=True)
