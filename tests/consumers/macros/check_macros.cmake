# amps's headers compile where a host has defined macros for nearly everything, ahead of the standard library or behind it. Run with:
#   cmake -D COMPILER=c++ -D SOURCE=project -D "EIGEN=include;folders" -P check_macros.cmake
cmake_minimum_required(VERSION 3.22)
set(flags -std=c++17 -fsyntax-only "-I${SOURCE}")
foreach(folder IN LISTS EIGEN)
  list(APPEND flags -isystem "${folder}")
endforeach()
foreach(order -DAMPS_MACROS_FIRST -UAMPS_MACROS_FIRST)
  execute_process(COMMAND ${COMPILER} ${flags} ${order} ${CMAKE_CURRENT_LIST_DIR}/main.cpp RESULT_VARIABLE code ERROR_VARIABLE text)
  if(NOT code EQUAL 0)
    message(FATAL_ERROR "under the macros of hosts.h (${order}) amps.h does not compile; what a host's macro hides belongs into "
      "amps/host_macros_begin.h and host_macros_end.h:\n${text}")
  endif()
endforeach()
