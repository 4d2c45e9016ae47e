; Functions of the C library of macOS that LLVM's instructions may become there, beside those of memory_functions.ll.

declare ptr @memset(ptr, i32, i64)

define void @bzero(ptr %to, i64 %count) nounwind {
  %filled = call ptr @memset(ptr %to, i32 0, i64 %count)
  ret void
}

define void @__bzero(ptr %to, i64 %count) nounwind {
  %filled = call ptr @memset(ptr %to, i32 0, i64 %count)
  ret void
}

define void @memset_pattern16(ptr %to, ptr %pattern, i64 %count) nounwind {
entry:
  %is_none = icmp eq i64 %count, 0
  br i1 %is_none, label %end, label %loop
loop:
  %n = phi i64 [0, %entry], [%following, %loop]
  %place = and i64 %n, 15
  %source = getelementptr i8, ptr %pattern, i64 %place
  %target = getelementptr i8, ptr %to, i64 %n
  %byte = load i8, ptr %source
  store i8 %byte, ptr %target
  %following = add i64 %n, 1
  %is_over = icmp eq i64 %following, %count
  br i1 %is_over, label %end, label %loop
end:
  ret void
}
