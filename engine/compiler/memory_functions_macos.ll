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
  %whole = load <2 x i64>, ptr %pattern, align 1
  %of_patterns = and i64 %count, -16
  br label %patterns
patterns:
  %p = phi i64 [0, %entry], [%p_after, %once]
  %has_pattern = icmp ult i64 %p, %of_patterns
  br i1 %has_pattern, label %once, label %rest
once:
  %p_to = getelementptr i8, ptr %to, i64 %p
  store <2 x i64> %whole, ptr %p_to, align 1
  %p_after = add i64 %p, 16
  br label %patterns
rest:
  %n = phi i64 [%p, %patterns], [%n_after, %last]
  %has_byte = icmp ult i64 %n, %count
  br i1 %has_byte, label %last, label %end
last:
  %place = and i64 %n, 15
  %n_from = getelementptr i8, ptr %pattern, i64 %place
  %n_to = getelementptr i8, ptr %to, i64 %n
  %byte = load i8, ptr %n_from
  store i8 %byte, ptr %n_to
  %n_after = add i64 %n, 1
  br label %rest
end:
  ret void
}
