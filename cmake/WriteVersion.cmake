cmake_policy(VERSION 3.25)
set(text ${VERSION})
execute_process(COMMAND git -C ${SOURCE_DIR} describe --always --dirty --abbrev=12
  OUTPUT_VARIABLE commit OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET RESULT_VARIABLE failed)
if(commit MATCHES "-dirty$")  # two changed trees are two versions
  execute_process(COMMAND git -C ${SOURCE_DIR} diff HEAD OUTPUT_VARIABLE changes)
  string(SHA1 hash "${changes}")
  string(SUBSTRING ${hash} 0 8 hash)
  string(APPEND commit "-${hash}")
endif()
if(NOT failed)
  string(APPEND text "+${commit}")
endif()
file(CONFIGURE OUTPUT ${OUTPUT} CONTENT
  "namespace tether {\nextern const char* const kVersion;\nconst char* const kVersion = \"@text@\";\n}\n" @ONLY)
