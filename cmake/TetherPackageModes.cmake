# Run by cpack on the packages that it has made.
if(CPACK_GENERATOR STREQUAL DEB)
  execute_process(COMMAND ${CPACK_TETHER_PYTHON} ${CMAKE_CURRENT_LIST_DIR}/fixed_deb.py ${CPACK_PACKAGE_FILES}
    COMMAND_ERROR_IS_FATAL ANY)
endif()
