"""A player as bytes: all that the audio thread reads and writes, for a program that runs its kernels without Python."""

from enum import IntEnum

from engine.export.scene_bytes import SceneBytes
from engine.live.audio_memory import AudioMemory
from engine.live.player import Player
from engine.runtime.jobs import Job

MEMORY, STATE = "memory", "state"


class KernelNumber(IntEnum):
    """Numbers of the kernels that are called by their addresses: places in a table of functions."""

    RENDER_BLOCK = 1
    INSERT_EVENT = 2


def lay_out_player(player: Player, pointer_bytes: int, base: int) -> SceneBytes:
    """Lay out the memory of a player that has not begun. Its value MEMORY is what the kernels take.

    base: address that the bytes will have
    """
    memory, job_memory = player.memory, player.memory.job_memory
    laid_out = SceneBytes(pointer_bytes, base)
    models = [f"model {n}" for n in range(len(memory.models))]
    for name, handle in zip(models, memory.model_handles, strict=True):
        laid_out.add(name, handle.value)
    laid_out.add(STATE, memory.state_handle.value)
    outputs = [f"output {n}" for n in range(len(job_memory.outputs))]
    for name, handle in zip(outputs, job_memory.outputs, strict=True):
        laid_out.add(name, handle.value)
    _add_job(laid_out, memory, models[0], outputs)
    shared = memory.shared._replace(
        job=laid_out.address("job"), state=laid_out.address(STATE), insert_event=KernelNumber.INSERT_EVENT
    )
    laid_out.add(MEMORY, shared)
    for n, name in enumerate(models):
        laid_out.set_number(shared.models, n, laid_out.address(name))
    return laid_out


def _add_job(laid_out: SceneBytes, memory: AudioMemory, model: str, outputs: list[str]) -> None:
    """Add the job of a block, and all that it names by address."""
    job_memory = memory.job_memory
    job, addresses = job_memory.job, job_memory.addresses
    laid_out.add("job", job)
    named = {Job.MODEL: model, Job.STATE: STATE, Job.AUDIO: job_memory.audio, Job.BALANCE: job_memory.balance}
    named |= {Job.LEDGER: job_memory.ledger}
    parts = {
        Job.OUTPUTS: outputs,
        Job.AUDIOS: [handle.value.audio for handle in job_memory.outputs],
        Job.LEDGERS: [handle.value.ledger for handle in job_memory.outputs],
    }
    for slot, what in named.items():
        if not isinstance(what, str):
            laid_out.add(slot.name, what)
        laid_out.set_number(job, slot, laid_out.address(what))
    for slot, each in parts.items():
        laid_out.add(slot.name, addresses[slot])
        laid_out.set_number(job, slot, laid_out.address(addresses[slot]))
        for n, what in enumerate(each):
            laid_out.set_number(addresses[slot], n, laid_out.address(what))
    laid_out.set_number(job, Job.RENDER_BLOCK, KernelNumber.RENDER_BLOCK)
    laid_out.set_number(job, Job.CREW, 0)
