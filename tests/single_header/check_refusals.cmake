# Checks that the single header is written from the sources as they are, and not from sources out of order. Works on copies in FOLDER;
# SOURCE is the project, HEADERS and SOURCES its lists.

# Writes the header from a fresh copy of the sources, after file FILE has got the line LINE at its end, and with lists as they are now.
# Fails unless the result is an error that contains ERROR; an empty one asks for success.
function(check file line error)
  file(REMOVE_RECURSE "${FOLDER}")
  file(COPY "${SOURCE}/amps" "${SOURCE}/LICENSE" DESTINATION "${FOLDER}")
  if(file)
    file(APPEND "${FOLDER}/${file}" "${line}\n")
  endif()
  execute_process(
    COMMAND ${CMAKE_COMMAND} -D "FOLDER=${FOLDER}" -D VERSION=0.0.0 -D "HEADERS=${HEADERS}" -D "SOURCES=${SOURCES}"
      -D "OUT=${FOLDER}/amps_single.h" -P "${FOLDER}/amps/single_header.cmake"
    RESULT_VARIABLE code ERROR_VARIABLE message)
  string(REGEX REPLACE "[ \n]+" " " message "${message}")  # CMake breaks lines
  string(FIND "${message}" "${error}" place)
  if(error STREQUAL "" AND NOT code EQUAL 0)
    message(FATAL_ERROR "the sources as they are: ${message}")
  elseif(NOT error STREQUAL "" AND (code EQUAL 0 OR place EQUAL -1 OR EXISTS "${FOLDER}/amps_single.h"))
    message(FATAL_ERROR "wanted the error '${error}', got code ${code} and '${message}'")
  endif()
endfunction()

check("" "" "")
check(amps/mesh.h "#include \"amps/remesh.h\"" "amps/mesh.h includes amps/remesh.h, which is not above it")
check(amps/mesh.h "#  include \"amps/mesh.h\"" "amps/mesh.h includes amps/mesh.h, which is not above it")
check(amps/remesh.h "#include \"amps/amps.h\"" "amps/remesh.h includes amps/amps.h, which is not above it")
check(amps/remesh.cpp "#include \"amps/amps.h\"" "amps/remesh.cpp includes amps/amps.h, which is not above it")
check(amps/remesh.cpp "#include \"amps/nothing.h\"" "amps/remesh.cpp includes amps/nothing.h, which is not in AMPS_HEADERS")
check(amps/remesh.cpp "#include \"helper.h\"" "amps/remesh.cpp includes helper.h, which is not in AMPS_HEADERS")
check(amps/new.h "" "amps/new.h is in neither")
check(amps/new.cpp "" "amps/new.cpp is in neither")

list(REMOVE_ITEM SOURCES amps/base.cpp)
check("" "" "amps/base.cpp is in neither")
list(APPEND SOURCES amps/base.cpp)
check("" "" "where the reading order of amps.h has 'amps/base.cpp'")
