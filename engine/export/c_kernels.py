"""The kernels of a library in C, as object files: those that come with the engine, as they are, or special ones, which
are compiled for the patch."""

from engine.compiler import cache, shipped
from engine.compiler.kernel_name import KernelName
from engine.compiler.kinds import Kind, effects_of
from engine.compiler.special_kernels import call_with_effects
from engine.compiler.targets import Target
from engine.export.faults import CannotExport

Request = tuple[str, str, tuple[Kind, ...]]  # module, function and kinds
KERNEL = "fdh_kernel"  # beginning of the names of the files


class LinkedKernels:
    """Kernels that a library needs.

    target: the machine that they are for
    name:   GENERAL or SPECIAL
    entries: names of their functions in C, without double ones
    """

    def __init__(self, target: Target, name: KernelName) -> None:
        self.target, self.name = target, name
        self._requests: dict[str, Request] = {}  # by the function in C
        self._parts = list[str]()  # of the archive

    @property
    def entries(self) -> list[str]:
        """Names of the functions in C."""
        return list(self._requests)

    def add(self, request: Request, part: str) -> str:
        """Add a kernel that is not there yet. Return its function in C. part: of the library, for names. Raises
        CannotExport if the archive does not have it."""
        for entry, known in self._requests.items():
            if known == request:
                return entry
        entry = self._shipped(request) if self.name is KernelName.GENERAL else f"fdh_{request[1]}_{part}"
        self._requests[entry] = request
        return entry

    def _shipped(self, request: Request) -> str:
        """Return the function of a kernel that comes with the engine, and note its object file."""
        path = shipped.archive(self.target)
        about = shipped.read_about(path)
        if about.get("sources") != cache.source_digest() or shipped.kernel_key(*request) not in about["kernels"]:
            raise CannotExport(
                f"the kernels for {self.target.name} that came with the engine are not of these sources; give --kernel"
                " special, or make them with: python -m bench shipped"
            )
        part, entry = about["kernels"][shipped.kernel_key(*request)]
        self._parts += [part] if part not in self._parts else []
        return str(entry)

    def objects(self) -> dict[str, bytes]:
        """Return the object files by name. Special kernels take half a minute to compile. Raises CannotExport if the
        archive cannot be read."""
        if self.name is KernelName.GENERAL:
            try:
                path = shipped.archive(self.target)
                return {f"{KERNEL}_{part}": shipped.read_part(path, part).machine_code for part in self._parts}
            except shipped.UNREADABLE as error:
                raise CannotExport(f"{shipped.archive(self.target).name} cannot be read: {error}") from None
        from engine.compiler.machine_code import neutral_code, object_code

        module = neutral_code.__module__
        codes = {
            entry: call_with_effects(effects_of(request[2]), module, "neutral_code", *request)
            for entry, request in self._requests.items()
        }
        return {f"{KERNEL}.o": object_code(codes, self.target, {}).content}

    def table_object(self, tables: dict[str, bytes]) -> bytes:
        """Return an object file with constant tables, by their names in C."""
        from engine.compiler.machine_code import object_code

        return object_code({}, self.target, tables).content
