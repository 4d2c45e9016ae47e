; Functions of the C library that LLVM's instructions may become. They are linked to kernels after all else has been
; optimised, or their loops would become calls of themselves.

define ptr @memset(ptr %to, i32 %value, i64 %count) nounwind {
entry:
  %byte = trunc i32 %value to i8
  %is_none = icmp eq i64 %count, 0
  br i1 %is_none, label %end, label %loop
loop:
  %n = phi i64 [0, %entry], [%following, %loop]
  %target = getelementptr i8, ptr %to, i64 %n
  store i8 %byte, ptr %target
  %following = add i64 %n, 1
  %is_over = icmp eq i64 %following, %count
  br i1 %is_over, label %end, label %loop
end:
  ret ptr %to
}

define ptr @memcpy(ptr %to, ptr %from, i64 %count) nounwind {
entry:
  %is_none = icmp eq i64 %count, 0
  br i1 %is_none, label %end, label %loop
loop:
  %n = phi i64 [0, %entry], [%following, %loop]
  %source = getelementptr i8, ptr %from, i64 %n
  %target = getelementptr i8, ptr %to, i64 %n
  %byte = load i8, ptr %source
  store i8 %byte, ptr %target
  %following = add i64 %n, 1
  %is_over = icmp eq i64 %following, %count
  br i1 %is_over, label %end, label %loop
end:
  ret ptr %to
}

define ptr @memmove(ptr %to, ptr %from, i64 %count) nounwind {
entry:
  %is_upwards = icmp ult ptr %to, %from
  br i1 %is_upwards, label %upwards, label %downwards
upwards:
  %copied = call ptr @memcpy(ptr %to, ptr %from, i64 %count)
  ret ptr %to
downwards:
  %is_none = icmp eq i64 %count, 0
  br i1 %is_none, label %end, label %loop
loop:
  %left = phi i64 [%count, %downwards], [%n, %loop]
  %n = sub i64 %left, 1
  %source = getelementptr i8, ptr %from, i64 %n
  %target = getelementptr i8, ptr %to, i64 %n
  %byte = load i8, ptr %source
  store i8 %byte, ptr %target
  %is_over = icmp eq i64 %n, 0
  br i1 %is_over, label %end, label %loop
end:
  ret ptr %to
}
