add_test(NAME lint_format COMMAND ${CMAKE_CURRENT_SOURCE_DIR}/lint_format.sh)
add_test(NAME lint_tidy COMMAND ${CMAKE_CURRENT_SOURCE_DIR}/lint_tidy.sh ${CMAKE_BINARY_DIR})
set_tests_properties(lint_format lint_tidy PROPERTIES LABELS lint)
set_tests_properties(lint_tidy PROPERTIES TIMEOUT 1500 COST 400)
