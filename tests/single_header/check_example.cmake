# Compiles EXAMPLE by the command in its head, in a folder with nothing but it and amps_single.h, and runs it. COMPILER stands in for the
# command's c++, and the environment says where Eigen and nanoflann are in case they are elsewhere. Warnings count as errors. Without
# optimisation, since compiling takes most of the time.
get_filename_component(name "${EXAMPLE}" NAME_WE)
file(STRINGS "${EXAMPLE}" command REGEX "^//   c\\+\\+ ")
string(REGEX REPLACE "^//   c\\+\\+ +" "" arguments "${command}")
separate_arguments(arguments UNIX_COMMAND "${arguments}")
list(LENGTH command count)
if(NOT count EQUAL 1)
  message(FATAL_ERROR "${EXAMPLE} does not have exactly one line that starts with '//   c++ '")
endif()

file(REMOVE_RECURSE "${FOLDER}")
file(COPY "${EXAMPLE}" "${HEADER_FOLDER}/amps_single.h" DESTINATION "${FOLDER}")
string(REPLACE ";" ":" includes "${INCLUDES}")
set(ENV{CPLUS_INCLUDE_PATH} "${includes}")
execute_process(COMMAND ${COMPILER} ${arguments} -O0 -Werror WORKING_DIRECTORY "${FOLDER}" COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND "${FOLDER}/${name}" WORKING_DIRECTORY "${FOLDER}" COMMAND_ERROR_IS_FATAL ANY)
