"""Scene files: reading TOML into a Scene, and writing it back."""

from dem_bridge.scene.file.load import MAIN_SCENES, load_scene, parse_scene, scene_of
from dem_bridge.scene.shipped import shipped_scenes

__all__ = ["MAIN_SCENES", "load_scene", "parse_scene", "scene_of", "shipped_scenes"]
