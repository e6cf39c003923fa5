# Writes OUT, a C++ header with each of FILES (in FOLDER) as an array of bytes: page.css becomes kFile_page_css. Bytes, since
# compilers limit the length of string literals and raw strings have a terminator that a file may hold.
set(text "// Generated from examples/report_page by embed.cmake.\n#pragma once\n\n")
foreach(file ${FILES})
  file(READ "${FOLDER}/${file}" bytes HEX)
  string(REGEX REPLACE "([0-9a-f][0-9a-f])" "0x\\1," bytes "${bytes}")
  string(REGEX REPLACE "((0x..,)(0x..,)(0x..,)(0x..,)(0x..,)(0x..,)(0x..,)(0x..,))" "\\1\n" bytes "${bytes}")
  string(MAKE_C_IDENTIFIER "kFile_${file}" name)
  string(APPEND text "inline constexpr unsigned char ${name}[] = {\n${bytes}};\n")
endforeach()
file(WRITE "${OUT}" "${text}")
