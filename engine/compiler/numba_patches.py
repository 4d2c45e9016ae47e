"""Changes to Numba's own compiler."""

import inspect
from typing import Any, ClassVar

from numba.core.codegen import CPUCodeLibrary, JITCPUCodegen

from engine.compiler.tricks import Trick, in_use


class SkipInlinedLibraries:
    """Leave out work on the libraries of inlined functions.

    Numba makes a library of each function with all it calls, optimises it and translates it to machine code. The
    library of an inlined function is never run. If both are left to the kernel that inlines it, they are done once
    instead of at each level of calls (28 → 18 s for a string on a bridge).
    """

    compiling: ClassVar[list[bool]] = []  # for each function being compiled, True if it is inlined

    @classmethod
    def active(cls) -> bool:
        """True if an inlined function is being compiled."""
        return bool(cls.compiling) and cls.compiling[-1]

    @classmethod
    def mark(cls, dispatcher: Any, inlined: bool) -> Any:
        """Mark a dispatcher's function as inlined or not, and return the dispatcher."""
        if not INSTALLED:
            return dispatcher
        compile_plainly = dispatcher._compiler.compile

        def compile_marked(*arguments: Any) -> Any:
            cls.compiling.append(inlined)
            try:
                return compile_plainly(*arguments)
            finally:
                cls.compiling.pop()

        dispatcher._compiler.compile = compile_marked
        return dispatcher

    @classmethod
    def install(cls, library: Any, codegen: Any) -> None:
        """Change Numba's library and code generator."""
        optimise, finalize = library._optimize_final_module, library._finalize_final_module
        set_environment = codegen.set_env

        def optimise_kernels(self: Any) -> None:
            if not cls.active():
                optimise(self)

        def finalize_kernels(self: Any) -> None:
            if cls.active():
                self._finalize_dynamic_globals()
                self._finalized = True
            else:
                finalize(self)

        def set_environment_of_kernels(self: Any, name: str, environment: Any) -> None:
            if not cls.active():  # that of an inlined function is not in memory; only code that raises would use it
                set_environment(self, name, environment)

        library._optimize_final_module, library._finalize_final_module = optimise_kernels, finalize_kernels
        codegen.set_env = set_environment_of_kernels

    @staticmethod
    def self_test() -> bool:
        """True if Numba has the methods that are changed, with the expected arguments, and a compiler to mark."""
        from numba.core import dispatcher

        methods = CPUCodeLibrary._optimize_final_module, CPUCodeLibrary._finalize_final_module
        plain = all(list(inspect.signature(method).parameters) == ["self"] for method in methods)
        environment = list(inspect.signature(JITCPUCodegen.set_env).parameters) == ["self", "env_name", "env"]
        inner: Any = dispatcher
        needed = inner._FunctionCompiler.compile, CPUCodeLibrary._finalize_dynamic_globals
        return plain and environment and all(map(callable, needed))


INSTALLED = in_use(Trick.SKIP_INLINED, SkipInlinedLibraries.self_test)
if INSTALLED:
    SkipInlinedLibraries.install(CPUCodeLibrary, JITCPUCodegen)
