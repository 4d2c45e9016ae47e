"""Intermediate code without what WebAssembly lacks.

It has no fused multiply-add but a relaxed one, which is fused wherever the processor can. Nor can it load and store the
first lanes of a vector alone: here all are, which the margins of the scene's arrays allow
(engine.export.scene_bytes.MARGIN), and the others keep what they held. LLVM would write a branch for each lane, and
take 20 GB to do so.
"""

import re

LANES, WIDTH = 8, 2  # numbers of a vector, and of one of WebAssembly
PAIR, ALL, MASK = "<2 x double>", f"<{LANES} x double>", f"<{LANES} x i1>"
FUSED = "llvm.wasm.relaxed.madd.v2f64"


def wasm_arithmetic(text: str) -> str:
    """Return intermediate code whose multiply-adds and masked vectors WebAssembly has."""
    text = re.sub(r"^declare [^\n]*@llvm\.fma\.(f64|v8f64)\([^\n]*\n", "", text, flags=re.M)
    text = text.replace("@llvm.fma.f64(", "@fdh_fused(").replace("@llvm.fma.v8f64(", "@fdh_fused_lanes(")
    text = re.sub(r"^declare [^\n]*@llvm\.masked\.(load|store)\.v8f64[^\n]*\n", "", text, flags=re.M)
    text = re.sub(r"@llvm\.masked\.(load|store)\.v8f64\.p0\(", r"@fdh_masked_\1(", text)
    text += f"declare {PAIR} @{FUSED}({PAIR}, {PAIR}, {PAIR})\n" + _fused_number() + _fused_lanes() + _masked()
    return text


def _fused_number() -> str:
    """Return the source of a·b + c of numbers, in the first lane of a pair."""
    first = [f"  %{v}2 = insertelement {PAIR} zeroinitializer, double %{v}, i32 0\n" for v in "abc"]
    return (
        "define internal double @fdh_fused(double %a, double %b, double %c) alwaysinline {\n"
        + "".join(first)
        + f"  %s = call {PAIR} @{FUSED}({PAIR} %a2, {PAIR} %b2, {PAIR} %c2)\n"
        + f"  %x = extractelement {PAIR} %s, i32 0\n  ret double %x\n}}\n"
    )


def _fused_lanes() -> str:
    """Return the source of a·b + c of eight lanes, pair by pair."""
    whole, lines = ALL, list[str]()
    for n in range(LANES // WIDTH):
        chosen = f"<2 x i32> <i32 {2 * n}, i32 {2 * n + 1}>"
        lines += [f"  %{v}{n} = shufflevector {whole} %{v}, {whole} poison, {chosen}\n" for v in "abc"]
        lines.append(f"  %s{n} = call {PAIR} @{FUSED}({PAIR} %a{n}, {PAIR} %b{n}, {PAIR} %c{n})\n")
    four, half = "<4 x double>", "<4 x i32> <i32 0, i32 1, i32 2, i32 3>"
    lines += [f"  %h{n} = shufflevector {PAIR} %s{2 * n}, {PAIR} %s{2 * n + 1}, {half}\n" for n in range(2)]
    every = ", ".join(f"i32 {n}" for n in range(LANES))
    lines.append(f"  %x = shufflevector {four} %h0, {four} %h1, <{LANES} x i32> <{every}>\n  ret {whole} %x\n")
    head = f"define internal {whole} @fdh_fused_lanes({whole} %a, {whole} %b, {whole} %c) alwaysinline {{\n"
    return head + "".join(lines) + "}\n"


def _masked() -> str:
    """Return the sources of a load and a store of some lanes."""
    return (
        f"define internal {ALL} @fdh_masked_load(ptr %from, {MASK} %mask, {ALL} %others) alwaysinline {{\n"
        f"  %all = load {ALL}, ptr %from, align 8\n"
        f"  %x = select {MASK} %mask, {ALL} %all, {ALL} %others\n  ret {ALL} %x\n}}\n"
        f"define internal void @fdh_masked_store({ALL} %values, ptr %to, {MASK} %mask) alwaysinline {{\n"
        f"  %all = load {ALL}, ptr %to, align 8\n"
        f"  %x = select {MASK} %mask, {ALL} %values, {ALL} %all\n"
        f"  store {ALL} %x, ptr %to, align 8\n  ret void\n}}\n"
    )
