; Functions of the C library that LLVM's instructions may become. They are linked to kernels after all else has been
; optimised, or their loops would become calls of themselves. Each goes on by 32 bytes, then by 8, then by one: byte by
; byte, kalimba took 1.2 times as long.

define ptr @memset(ptr %to, i32 %value, i64 %count) nounwind {
entry:
  %byte = trunc i32 %value to i8
  %bytes = zext i8 %byte to i64
  %word = mul i64 %bytes, 72340172838076673
  %one = insertelement <4 x i64> poison, i64 %word, i64 0
  %four = shufflevector <4 x i64> %one, <4 x i64> poison, <4 x i32> zeroinitializer
  %of_vectors = and i64 %count, -32
  %of_words = and i64 %count, -8
  br label %vectors
vectors:
  %v = phi i64 [0, %entry], [%v_after, %vector]
  %has_vector = icmp ult i64 %v, %of_vectors
  br i1 %has_vector, label %vector, label %words
vector:
  %v_to = getelementptr i8, ptr %to, i64 %v
  store <4 x i64> %four, ptr %v_to, align 1
  %v_after = add i64 %v, 32
  br label %vectors
words:
  %w = phi i64 [%v, %vectors], [%w_after, %word_of_8]
  %has_word = icmp ult i64 %w, %of_words
  br i1 %has_word, label %word_of_8, label %rest
word_of_8:
  %w_to = getelementptr i8, ptr %to, i64 %w
  store i64 %word, ptr %w_to, align 1
  %w_after = add i64 %w, 8
  br label %words
rest:
  %n = phi i64 [%w, %words], [%n_after, %last]
  %has_byte = icmp ult i64 %n, %count
  br i1 %has_byte, label %last, label %end
last:
  %n_to = getelementptr i8, ptr %to, i64 %n
  store i8 %byte, ptr %n_to
  %n_after = add i64 %n, 1
  br label %rest
end:
  ret ptr %to
}

define ptr @memcpy(ptr %to, ptr %from, i64 %count) nounwind {
entry:
  %of_vectors = and i64 %count, -32
  %of_words = and i64 %count, -8
  br label %vectors
vectors:
  %v = phi i64 [0, %entry], [%v_after, %vector]
  %has_vector = icmp ult i64 %v, %of_vectors
  br i1 %has_vector, label %vector, label %words
vector:
  %v_from = getelementptr i8, ptr %from, i64 %v
  %v_to = getelementptr i8, ptr %to, i64 %v
  %four = load <4 x i64>, ptr %v_from, align 1
  store <4 x i64> %four, ptr %v_to, align 1
  %v_after = add i64 %v, 32
  br label %vectors
words:
  %w = phi i64 [%v, %vectors], [%w_after, %word_of_8]
  %has_word = icmp ult i64 %w, %of_words
  br i1 %has_word, label %word_of_8, label %rest
word_of_8:
  %w_from = getelementptr i8, ptr %from, i64 %w
  %w_to = getelementptr i8, ptr %to, i64 %w
  %word = load i64, ptr %w_from, align 1
  store i64 %word, ptr %w_to, align 1
  %w_after = add i64 %w, 8
  br label %words
rest:
  %n = phi i64 [%w, %words], [%n_after, %last]
  %has_byte = icmp ult i64 %n, %count
  br i1 %has_byte, label %last, label %end
last:
  %n_from = getelementptr i8, ptr %from, i64 %n
  %n_to = getelementptr i8, ptr %to, i64 %n
  %byte = load i8, ptr %n_from
  store i8 %byte, ptr %n_to
  %n_after = add i64 %n, 1
  br label %rest
end:
  ret ptr %to
}

; Upwards it is memcpy, which reads what it moves before it writes on it; downwards it begins with the last bytes.
define ptr @memmove(ptr %to, ptr %from, i64 %count) nounwind {
entry:
  %is_upwards = icmp ule ptr %to, %from
  br i1 %is_upwards, label %upwards, label %rest
upwards:
  %copied = call ptr @memcpy(ptr %to, ptr %from, i64 %count)
  ret ptr %to
rest:
  %n = phi i64 [%count, %entry], [%n_after, %last]
  %odd = and i64 %n, 7
  %has_byte = icmp ne i64 %odd, 0
  br i1 %has_byte, label %last, label %words
last:
  %n_after = sub i64 %n, 1
  %n_from = getelementptr i8, ptr %from, i64 %n_after
  %n_to = getelementptr i8, ptr %to, i64 %n_after
  %byte = load i8, ptr %n_from
  store i8 %byte, ptr %n_to
  br label %rest
words:
  %w = phi i64 [%n, %rest], [%w_after, %word_of_8]
  %beyond = and i64 %w, 31
  %has_word = icmp ne i64 %beyond, 0
  br i1 %has_word, label %word_of_8, label %vectors
word_of_8:
  %w_after = sub i64 %w, 8
  %w_from = getelementptr i8, ptr %from, i64 %w_after
  %w_to = getelementptr i8, ptr %to, i64 %w_after
  %word = load i64, ptr %w_from, align 1
  store i64 %word, ptr %w_to, align 1
  br label %words
vectors:
  %v = phi i64 [%w, %words], [%v_after, %vector]
  %has_vector = icmp ne i64 %v, 0
  br i1 %has_vector, label %vector, label %end
vector:
  %v_after = sub i64 %v, 32
  %v_from = getelementptr i8, ptr %from, i64 %v_after
  %v_to = getelementptr i8, ptr %to, i64 %v_after
  %four = load <4 x i64>, ptr %v_from, align 1
  store <4 x i64> %four, ptr %v_to, align 1
  br label %vectors
end:
  ret ptr %to
}
