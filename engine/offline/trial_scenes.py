"""The scenes by which an archive of kernels is tried on a machine (engine.compiler.archive_trial):
`python -m engine.offline.trial_scenes` prints the digest of their samples."""

import hashlib
from typing import Any

from engine.compiler.kernel_name import KernelName
from engine.files import SHIPPED_PATCHES
from engine.offline.render import render_arrays
from engine.patch.scene import load

SCENES: tuple[tuple[str, float, dict[str, Any]], ...] = (  # patch, seconds, accuracy
    ("bouncing_ball", 0.05, {}),
    ("bowed_vibraphone", 0.01, {}),
    ("slack_bass", 0.01, {}),
    ("marimba", 0.005, {"order": 4}),  # of the kernel with stages
)


def digest_samples() -> str:
    """Return the digest of the samples of all scenes, as the general kernel makes them on one core."""
    digest = hashlib.sha256()
    for name, seconds, accuracy in SCENES:
        scene = load(SHIPPED_PATCHES / f"{name}.toml")
        rendered = render_arrays(scene, seconds, kernel=KernelName.GENERAL, cores=1, **accuracy)
        digest.update(rendered.audio.tobytes())
    return digest.hexdigest()


if __name__ == "__main__":
    print(digest_samples())
