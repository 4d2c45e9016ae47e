"""The level of a processor: what it has beyond the least of its family, on x86-64 and on aarch64."""

import platform

from engine.compiler.targets import V3, V4, X86_64

X86_LEVELS = (  # the least first; each has the features of those before it, as LLVM calls them
    ("x86-64-v2", ("cx16", "popcnt", "sahf", "sse3", "sse4.1", "sse4.2", "ssse3")),
    ("x86-64-v3", V3),
    ("x86-64-v4", V4[len(V3) :]),
)
ARM_FEATURES = "neon", "lse", "fullfp16", "dotprod", "bf16", "i8mm", "sve", "sve2"


def describe_level() -> str:
    """Return the level of this processor, such as x86-64-v3, or aarch64 with neon and lse."""
    import llvmlite.binding as llvm

    features, machine = llvm.get_host_cpu_features(), platform.machine().lower()
    if machine in X86_64:
        level = "x86-64"
        for name, needed in X86_LEVELS:
            if not all(features.get(feature) for feature in needed):
                break
            level = name
        return level
    present = [name for name in ARM_FEATURES if features.get(name)]
    return f"{machine} with {', '.join(present)}" if present else machine
