# SPDX-License-Identifier: Apache-2.0
# fcsv_install_nodes(): the executables in nodes/ become the package's, in the devel and in the install space.
# Both run the interpreter that the workspace was configured with (-DPYTHON_EXECUTABLE), whatever their first line says:
# the devel space by catkin's wrappers, the install space by a first line that is written at the installation.
function(fcsv_install_nodes)
  file(GLOB nodes CONFIGURE_DEPENDS nodes/*)
  catkin_install_python(PROGRAMS ${nodes} DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
  install(CODE "
    foreach(node ${nodes})
      get_filename_component(name \${node} NAME)
      set(installed \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}/${CATKIN_PACKAGE_BIN_DESTINATION}/\${name}\")
      file(READ \"\${node}\" text)
      string(REGEX REPLACE \"^#![^\\n]*\" \"#!${PYTHON_EXECUTABLE}\" text \"\${text}\")
      file(WRITE \"\${installed}\" \"\${text}\")
    endforeach()")
endfunction()
