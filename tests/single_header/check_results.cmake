# Builds results.cpp and implementation.cpp against the single header with COMPILER, warnings as errors, and compares what the program
# prints with what REFERENCE prints. Run by CTest; see CMakeLists.txt for the variables.
list(TRANSFORM INCLUDES PREPEND "-isystem")
set(options -std=c++17 -O2 ${FLAGS} -Wall -Wextra -Wpedantic -Wconversion -Wshadow -Werror "-I${HEADER_FOLDER}" ${INCLUDES})
file(MAKE_DIRECTORY "${FOLDER}")

function(run)
  execute_process(COMMAND ${COMPILER} ${ARGN} WORKING_DIRECTORY "${FOLDER}" RESULT_VARIABLE code)
  if(NOT code EQUAL 0)
    message(FATAL_ERROR "this failed: ${COMPILER} ${ARGN}")
  endif()
endfunction()
run(${options} -DAMPS_TEST_SINGLE -c "${CMAKE_CURRENT_LIST_DIR}/results.cpp" -o results.o)
run(${options} -DAMPS_TEST_DECLARATIONS_FIRST -fsyntax-only "${CMAKE_CURRENT_LIST_DIR}/implementation.cpp")
run(${options} -c "${CMAKE_CURRENT_LIST_DIR}/implementation.cpp" -o implementation.o)
run(results.o implementation.o -pthread -o results)

execute_process(COMMAND "${FOLDER}/results" OUTPUT_VARIABLE single COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND "${REFERENCE}" OUTPUT_VARIABLE library COMMAND_ERROR_IS_FATAL ANY)
if(NOT single STREQUAL library OR library STREQUAL "")
  message(FATAL_ERROR "the single header gives\n${single}and the library\n${library}")
endif()
message(STATUS "equal:\n${library}")
