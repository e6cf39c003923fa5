# Joins the library into one header in stb style: the declarations, then, where AMPS_IMPLEMENTATION is defined, internal headers and
# sources. It stands beside the files it joins and is given their names, in reading order, by the top CMakeLists.txt:
#
#   cmake -D FOLDER=. -D VERSION=0.1.0 -D "HEADERS=amps/amps.h;..." -D "SOURCES=amps/base.cpp;..." -D OUT=amps_single.h \
#         -P amps/single_header.cmake
#
# Fails where a header includes one that is not above it, and where lists, folder and the reading order in amps.h differ. Line n of a
# file is n lines below the comment that names it, since a dropped line leaves an empty one.
cmake_minimum_required(VERSION 3.22)
foreach(argument FOLDER VERSION HEADERS SOURCES OUT)
  if(NOT ${argument})
    message(FATAL_ERROR "single_header.cmake needs -D ${argument}=...")
  endif()
endforeach()

# Switches contraction off and has no `#pragma once`: the lines stand ahead of the implementation, wherever that is asked for.
set(switch_off amps/contraction.h)
# They stand once around all of it.
set(macros_begin amps/host_macros_begin.h)
set(macros_end amps/host_macros_end.h)

# Checks that HEADERS and SOURCES name every file of the folder, in the order amps.h gives.
function(check_lists)
  file(GLOB present RELATIVE "${FOLDER}" "${FOLDER}/amps/*.h" "${FOLDER}/amps/*.cpp")
  foreach(file IN LISTS present)
    if(NOT file IN_LIST HEADERS AND NOT file IN_LIST SOURCES)
      message(FATAL_ERROR "single header: ${file} is in neither AMPS_HEADERS nor AMPS_SOURCES")
    endif()
  endforeach()
  file(STRINGS "${FOLDER}/amps/amps.h" described REGEX "^//   [a-z][a-z0-9_]*(\\.h)?  ")
  set(told_HEADERS amps/amps.h)
  set(told_SOURCES)
  foreach(line IN LISTS described)
    string(REGEX REPLACE "^//   ([a-z0-9_]+).*" "amps/\\1" stem "${line}")
    if(EXISTS "${FOLDER}/${stem}.h")
      list(APPEND told_HEADERS ${stem}.h)
    endif()
    if(EXISTS "${FOLDER}/${stem}.cpp")
      list(APPEND told_SOURCES ${stem}.cpp)
    endif()
  endforeach()
  foreach(kind HEADERS SOURCES)
    foreach(listed told IN ZIP_LISTS ${kind} told_${kind})
      if(NOT listed STREQUAL told)
        message(FATAL_ERROR "single header: AMPS_${kind} has '${listed}' where the reading order of amps.h has '${told}'")
      endif()
    endforeach()
  endforeach()
endfunction()

# Sets RESULT to the headers that FILE includes. Each must be in HEADERS and, for a header but amps.h, above it; none may be amps.h,
# which has all below it.
function(get_includes file result)
  file(STRINGS "${FOLDER}/${file}" lines REGEX "^ *# *include *\"")
  list(FIND HEADERS ${file} place)
  set(found)
  foreach(line IN LISTS lines)
    string(REGEX REPLACE "^[^\"]*\"([^\"]*)\".*" "\\1" header "${line}")
    list(FIND HEADERS "${header}" header_place)
    if(header_place EQUAL -1)
      message(FATAL_ERROR "single header: ${file} includes ${header}, which is not in AMPS_HEADERS")
    elseif(header STREQUAL "amps/amps.h" OR (place GREATER 0 AND NOT header_place LESS place))
      message(FATAL_ERROR "single header: ${file} includes ${header}, which is not above it")
    endif()
    list(APPEND found ${header})
  endforeach()
  set(${result} "${found}" PARENT_SCOPE)
endfunction()

# What means something in a CMake list stands as a control character between read_lines and restore.
string(ASCII 1 backslash)
string(ASCII 2 semicolon)
string(ASCII 3 opening)
string(ASCII 4 closing)
function(read_lines file result)
  file(READ "${FOLDER}/${file}" text)
  string(REPLACE "\\" "${backslash}" text "${text}")
  string(REPLACE ";" "${semicolon}" text "${text}")
  string(REPLACE "[" "${opening}" text "${text}")
  string(REPLACE "]" "${closing}" text "${text}")
  string(REGEX REPLACE "\n$" "" text "${text}")
  string(REPLACE "\n" ";" text "${text}")
  set(${result} "${text}" PARENT_SCOPE)
endfunction()
function(restore result)
  set(text "${${result}}")
  string(REPLACE "${backslash}" "\\" text "${text}")
  string(REPLACE "${semicolon}" ";" text "${text}")
  string(REPLACE "${opening}" "[" text "${text}")
  string(REPLACE "${closing}" "]" text "${text}")
  set(${result} "${text}" PARENT_SCOPE)
endfunction()

# Appends FILE to the text of PART. Dropped are its includes of amps, `#pragma once`, AMPS_OWN_SOURCE, and a system include that stands
# unconditionally in an earlier file. Macros it defines are added to PART_macros.
set(system_includes)
function(append_file part file)
  read_lines(${file} lines)
  set(text)
  set(depth 0)  # of #if
  foreach(line IN LISTS lines)
    if(line MATCHES "^ *#")
      if(line MATCHES "^ *# *if")
        math(EXPR depth "${depth} + 1")
      elseif(line MATCHES "^ *# *endif")
        math(EXPR depth "${depth} - 1")
      elseif(line MATCHES "^ *# *include *\"|^ *# *pragma +once|^ *# *define +AMPS_OWN_SOURCE")
        set(line)
      elseif(line MATCHES "^ *# *include *(<[^>]*>)" AND depth EQUAL 0)
        if(CMAKE_MATCH_1 IN_LIST system_includes)
          set(line)
        else()
          list(APPEND system_includes "${CMAKE_MATCH_1}")
        endif()
      elseif(line MATCHES "^ *# *define +([A-Za-z0-9_]+)")
        list(APPEND ${part}_macros ${CMAKE_MATCH_1})
      endif()
    endif()
    string(APPEND text "${line}\n")
  endforeach()
  restore(text)
  set(${part} "${${part}}\n// From ${file}:\n${text}" PARENT_SCOPE)
  set(${part}_macros "${${part}_macros}" PARENT_SCOPE)
  set(system_includes "${system_includes}" PARENT_SCOPE)
endfunction()

# Declarations are what amps.h includes, and what that includes. Includes lead upwards, so one pass from the bottom finds them all.
check_lists()
get_includes(amps/amps.h declared)
set(upwards ${HEADERS})
list(REVERSE upwards)
foreach(header IN LISTS upwards)
  get_includes(${header} includes)
  if(header IN_LIST declared)
    list(APPEND declared ${includes})
  endif()
endforeach()
foreach(source IN LISTS SOURCES)
  get_includes(${source} includes)
endforeach()

append_file(contraction ${switch_off})
append_file(save_macros ${macros_begin})
append_file(restore_macros ${macros_end})
set(around amps/amps.h ${switch_off} ${macros_begin} ${macros_end})
list(REMOVE_ITEM declared ${around})
append_file(declarations amps/amps.h)
foreach(header IN LISTS HEADERS)
  if(header IN_LIST declared)
    append_file(declarations ${header})
  endif()
endforeach()
foreach(file IN LISTS HEADERS SOURCES)
  if(NOT file IN_LIST declared AND NOT file IN_LIST around)
    append_file(implementation ${file})
  endif()
endforeach()
list(REMOVE_DUPLICATES implementation_macros)
list(TRANSFORM implementation_macros REPLACE "(.+)" "#undef \\1\n" OUTPUT_VARIABLE undefine)
string(JOIN "" undefine ${undefine})

file(STRINGS "${FOLDER}/${macros_begin}" foreign_macros REGEX "^#undef ")
list(TRANSFORM foreign_macros REPLACE "#undef " "")
string(JOIN ", " foreign_macros ${foreign_macros})

file(READ "${FOLDER}/LICENSE" licence)
string(STRIP "${licence}" licence)
string(REPLACE "\n" "\n// " licence "// ${licence}")
string(REPLACE "// \n" "//\n" licence "${licence}")

file(WRITE "${OUT}" "\
// amps_single.h: amps ${VERSION} in one file. Maximal Poisson-disk sampling on surfaces, and remeshing with it.
//
// Made from the sources by the target amps_single_header; do not edit. Include it wherever amps is used. In exactly one file, best one
// that holds nothing else, ask for the implementation:
//
//   #define AMPS_IMPLEMENTATION
//   #include \"amps_single.h\"
//
// Needs C++17, Eigen 3.3 or newer, threads (-pthread) and, in that one file, nanoflann.
//
// It may be included any number of times, with and without AMPS_IMPLEMENTATION, in any order. Compile the file with the implementation
// without -ffast-math. Results are the same bits with every compiler where amps_single.h comes ahead of Eigen in that file: amps switches
// fused multiply-add off down to its end, for what comes in between and no further (MSVC: to the end of the file, and a
// `#pragma STDC FP_CONTRACT` of your own above is back at the default of the command line after it).
//
// Macros called ${foreign_macros}
// are set aside while it is read. Other macros that are common words must be defined after it, and a function of amps that such a macro
// hides is called with parentheses around: (amps::check)(mesh). Never use it beside \"amps/amps.h\".
//
${licence}

#if defined(AMPS_IMPLEMENTATION) && !defined(AMPS_SINGLE_IMPLEMENTED)
#define AMPS_OWN_SOURCE
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC push_options
#endif
${contraction}#endif
${save_macros}
#ifndef AMPS_SINGLE_DECLARED
#define AMPS_SINGLE_DECLARED
#ifdef AMPS_VERSION_MAJOR
#error \"amps/amps.h and amps_single.h are the same library: include one of them\"
#endif
${declarations}#endif  // AMPS_SINGLE_DECLARED

#ifdef AMPS_OWN_SOURCE
${implementation}
// End of the implementation.
${undefine}#endif

${restore_macros}#ifdef AMPS_OWN_SOURCE
#undef AMPS_OWN_SOURCE
#define AMPS_SINGLE_IMPLEMENTED
#if defined(__clang__)
#pragma STDC FP_CONTRACT DEFAULT
#elif defined(__GNUC__)
#pragma GCC pop_options
#endif
#endif
")
