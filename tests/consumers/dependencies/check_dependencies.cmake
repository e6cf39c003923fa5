# Where amps takes Eigen and nanoflann from, and what it says where they are not: projects that have them in all ways, configured and not
# built. Run with:
#   cmake -D SOURCE=project -D FOLDER=scratch -D GENERATOR=... -D COMPILER=c++ -D "NANOFLANN=folders" -P check_dependencies.cmake
cmake_minimum_required(VERSION 3.22)
file(REMOVE_RECURSE "${FOLDER}")
find_path(NANOFLANN nanoflann.hpp PATHS ${NANOFLANN})
# The projects see nothing of this system but the compiler.
set(alone)
foreach(place CMAKE_SYSTEM_PATH SYSTEM_ENVIRONMENT_PATH PACKAGE_REGISTRY SYSTEM_PACKAGE_REGISTRY CMAKE_ENVIRONMENT_PATH)
  string(APPEND alone "set(CMAKE_FIND_USE_${place} OFF)\nset(CMAKE_FIND_USE_CMAKE_${place} OFF)\n")
endforeach()

# Configures a project NAME of this body (AMPS_HERE adds amps), with further options. Sets `code`, `text` and `seconds`.
function(configure name body)
  string(REPLACE "AMPS_HERE" "add_subdirectory(\"${SOURCE}\" amps)" body "${body}")
  file(WRITE "${FOLDER}/${name}/CMakeLists.txt" "cmake_minimum_required(VERSION 3.22)\nproject(host LANGUAGES CXX)\n${alone}${body}
file(WRITE \"\${CMAKE_BINARY_DIR}/main.cpp\" \"#include <amps/amps.h>\\nint main() {}\\n\")
add_executable(host \"\${CMAKE_BINARY_DIR}/main.cpp\")
target_link_libraries(host PRIVATE amps::amps)\n")
  string(TIMESTAMP start "%s")
  execute_process(COMMAND ${CMAKE_COMMAND} -S "${FOLDER}/${name}" -B "${FOLDER}/${name}/build" -G "${GENERATOR}"
      -DCMAKE_CXX_COMPILER=${COMPILER} -DCMAKE_EXPORT_COMPILE_COMMANDS=ON ${ARGN}
    RESULT_VARIABLE code OUTPUT_VARIABLE text ERROR_VARIABLE error)
  string(TIMESTAMP end "%s")
  math(EXPR seconds "${end} - ${start}")
  set(code "${code}" PARENT_SCOPE)
  set(text "${text}${error}" PARENT_SCOPE)
  set(seconds "${seconds}" PARENT_SCOPE)
endfunction()

function(fails what)
  message(FATAL_ERROR "${what}:\n${text}")
endfunction()
macro(expect_success name)
  if(NOT code EQUAL 0 OR text MATCHES "fetching")
    fails("${name}: not configured")
  endif()
endmacro()
# The compiler's command of a source of project NAME holds FOLDER.
function(expect_folder name source folder)
  if(EXISTS "${FOLDER}/${name}/build/compile_commands.json")  # not every generator writes it
    file(READ "${FOLDER}/${name}/build/compile_commands.json" commands)
    string(REGEX MATCH "[^\n]*${source}\\.cpp[^\n]*" command "${commands}")
    if(NOT command MATCHES "${folder}")
      message(FATAL_ERROR "${name}: ${source}.cpp does not see ${folder}: ${command}")
    endif()
  endif()
endfunction()

# Where the headers themselves are, for the projects that have them in a target of their own.
set(own_eigen "add_library(eigen INTERFACE)\ntarget_include_directories(eigen INTERFACE \"\${CMAKE_CURRENT_SOURCE_DIR}/own_eigen\")
add_library(Eigen3::Eigen ALIAS eigen)\n")
set(own_nanoflann "add_library(nanoflann INTERFACE)\ntarget_include_directories(nanoflann INTERFACE \"\${CMAKE_CURRENT_SOURCE_DIR}/own_nanoflann\")
add_library(nanoflann::nanoflann ALIAS nanoflann)\n")
set(eigen_here "-DEigen3_DIR=${FOLDER}/eigen_3.4.0")
set(nanoflann_here "-DAMPS_NANOFLANN_INCLUDE_DIR=${NANOFLANN}")

# A package of Eigen with a version, as Eigen's own: its version file accepts its own major version.
function(write_eigen_package version)
  include(CMakePackageConfigHelpers)
  set(CMAKE_SIZEOF_VOID_P 8)
  write_basic_package_version_file("${FOLDER}/eigen_${version}/Eigen3ConfigVersion.cmake" VERSION ${version}
    COMPATIBILITY SameMajorVersion ARCH_INDEPENDENT)
  file(WRITE "${FOLDER}/eigen_${version}/Eigen3Config.cmake" "add_library(Eigen3::Eigen INTERFACE IMPORTED)
set_target_properties(Eigen3::Eigen PROPERTIES INTERFACE_INCLUDE_DIRECTORIES \"\${CMAKE_CURRENT_LIST_DIR}/include\")\n")
  file(MAKE_DIRECTORY "${FOLDER}/eigen_${version}/include/Eigen")
endfunction()
foreach(version 3.2.10 3.3.0 3.4.0 4.1.0 5.0.1 6.0.0)
  write_eigen_package(${version})
endforeach()

# A parent that adds its own Eigen, of the same name, behind amps: amps takes no name away.
configure(eigen_after "AMPS_HERE\n${own_eigen}" ${eigen_here} ${nanoflann_here})
expect_success(eigen_after)
expect_folder(eigen_after main eigen_3.4.0/include)

# One that has both ahead of it.
configure(own_targets "${own_eigen}${own_nanoflann}AMPS_HERE\n" -DFETCHCONTENT_FULLY_DISCONNECTED=ON)
expect_success(own_targets)
expect_folder(own_targets main own_eigen)
expect_folder(own_targets kdtree own_nanoflann)

# And installs amps, also as a shared library.
foreach(shared ON OFF)
  configure(own_installed_${shared} "${own_eigen}${own_nanoflann}AMPS_HERE\nadd_library(host::amps ALIAS amps)\n" -DAMPS_INSTALL=ON
    -DBUILD_SHARED_LIBS=${shared})
  expect_success(own_installed_${shared})
endforeach()

# A folder of headers without a package.
file(WRITE "${FOLDER}/headers/Eigen/Core" "")
configure(folder "AMPS_HERE\n" -DAMPS_EIGEN_INCLUDE_DIR=${FOLDER}/headers ${nanoflann_here})
expect_success(folder)
expect_folder(folder main "${FOLDER}/headers")

# Versions.
foreach(version 3.3.0 3.4.0 4.1.0 5.0.1)
  configure(version_${version} "AMPS_HERE\n" -DEigen3_DIR=${FOLDER}/eigen_${version} ${nanoflann_here} -DAMPS_DOWNLOAD=OFF)
  expect_success(version_${version})
  expect_folder(version_${version} main eigen_${version}/include)
endforeach()
foreach(version 3.2.10 6.0.0)
  configure(version_${version} "AMPS_HERE\n" -DCMAKE_PREFIX_PATH=${FOLDER}/eigen_${version} ${nanoflann_here} -DAMPS_DOWNLOAD=OFF)
  if(code EQUAL 0 OR NOT text MATCHES "Eigen ${version} was found")
    fails("Eigen ${version} is not refused by its version")
  endif()
endforeach()

# Nothing there, and no way to fetch it: one message that says what to do, soon.
function(expect_advice name)
  string(REGEX MATCHALL "CMake Error" errors "${text}")
  list(LENGTH errors count)
  if(code EQUAL 0 OR NOT count EQUAL 1)
    fails("${name}: ${count} errors, not one")
  endif()
  foreach(word libeigen3-dev libnanoflann-dev Eigen3_DIR AMPS_EIGEN_INCLUDE_DIR AMPS_NANOFLANN_INCLUDE_DIR "${ARGN}")
    if(NOT text MATCHES "${word}")
      fails("${name}: the message does not tell of ${word}")
    endif()
  endforeach()
endfunction()
configure(no_download "AMPS_HERE\n" -DAMPS_DOWNLOAD=OFF)
expect_advice(no_download "AMPS_DOWNLOAD is off")
foreach(proxy http://127.0.0.1:9 http://10.255.255.1:9)  # refuses at once; does not answer
  string(MAKE_C_IDENTIFIER "offline_${proxy}" name)
  foreach(variable https_proxy http_proxy all_proxy HTTPS_PROXY ALL_PROXY)
    set(ENV{${variable}} ${proxy})
  endforeach()
  set(ENV{no_proxy} "")
  configure(${name} "AMPS_HERE\n")
  expect_advice(${name} gitlab.com)
  if(seconds GREATER 10)  # 4 for the attempt, the rest for the compiler's checks on a busy machine
    fails("${name}: it took ${seconds} s to say so")
  endif()
endforeach()
