cmake_policy(VERSION 3.25)
set(text ${VERSION})
execute_process(COMMAND git -C ${SOURCE_DIR} describe --always --dirty --abbrev=12
  OUTPUT_VARIABLE commit OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET RESULT_VARIABLE failed)
if(NOT failed)
  string(APPEND text "+${commit}")
endif()
file(CONFIGURE OUTPUT ${OUTPUT} CONTENT
  "#pragma once\n\nnamespace tether {\ninline constexpr char kVersion[] = \"@text@\";\n}\n" @ONLY)
