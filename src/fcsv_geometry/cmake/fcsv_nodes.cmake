# SPDX-License-Identifier: Apache-2.0
# fcsv_pin_interpreter(): the executables of nodes/ run, in the install space too, the interpreter that the workspace
# was configured with (-DPYTHON_EXECUTABLE). catkin's wrappers in the devel space do so; what it installs on Debian
# begins with `env python3`, which lacks what requirements.txt pins. Call it after catkin_install_python().
function(fcsv_pin_interpreter)
  file(GLOB nodes RELATIVE ${CMAKE_CURRENT_SOURCE_DIR}/nodes CONFIGURE_DEPENDS nodes/*)
  install(CODE "
    foreach(name ${nodes})
      set(installed \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}/${CATKIN_PACKAGE_BIN_DESTINATION}/\${name}\")
      file(READ \"\${installed}\" text)
      string(REGEX REPLACE \"^#![^\\n]*\" \"#!${PYTHON_EXECUTABLE}\" text \"\${text}\")
      file(WRITE \"\${installed}\" \"\${text}\")
    endforeach()")
endfunction()
