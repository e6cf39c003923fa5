# amps's headers give no warning in a strict program, as headers of its own. Run with:
#   cmake -D COMPILER=c++ -D SOURCE=project -D "EIGEN=include;folders" -P check_warnings.cmake
cmake_minimum_required(VERSION 3.22)
set(flags -std=c++17 "-I${SOURCE}" -Werror)
foreach(folder IN LISTS EIGEN)
  list(APPEND flags -isystem "${folder}")
endforeach()
execute_process(COMMAND ${COMPILER} --version OUTPUT_VARIABLE version)
if(version MATCHES "clang")
  # Left out: what asks for C++98, tells of room between members, or forbids pointers and comparisons of doubles.
  list(APPEND flags -fsyntax-only -Weverything -Wno-unknown-warning-option -Wno-c++98-compat -Wno-c++98-compat-pedantic -Wno-padded
    -Wno-float-equal -Wno-unsafe-buffer-usage -Wno-unsafe-buffer-usage-in-container -Wno-unsafe-buffer-usage-in-libc-call)
else()  # optimised: some of its warnings need that
  list(APPEND flags -c -o ${CMAKE_CURRENT_BINARY_DIR}/warnings.o -O2 -Wall -Wextra -Wpedantic -Wconversion -Wsign-conversion -Wshadow)
endif()
execute_process(COMMAND ${COMPILER} ${flags} ${CMAKE_CURRENT_LIST_DIR}/main.cpp RESULT_VARIABLE code ERROR_VARIABLE text)
if(NOT code EQUAL 0)
  message(FATAL_ERROR "public headers give warnings:\n${text}")
endif()
