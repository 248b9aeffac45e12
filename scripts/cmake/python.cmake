# SPDX-License-Identifier: Apache-2.0
# Finds what the Python module needs: an interpreter that has NumPy, its headers, and pybind11.
#
# Sets GS_HAVE_PYTHON, Python3_EXECUTABLE, GS_PYBIND11_DIR, GS_PYTHON_INSTALL_DIR.
set(GS_HAVE_PYTHON FALSE)

# gs_find_python(result): the first interpreter that has NumPy. The one on the PATH is often an
# environment without it.
function(gs_find_python result)
  foreach(python IN ITEMS "${GS_PYTHON}" python3 /usr/bin/python3)
    if(python STREQUAL "")
      continue()
    endif()
    execute_process(COMMAND ${python} -c "import numpy, sys; print(sys.executable)"
      OUTPUT_VARIABLE found RESULT_VARIABLE code ERROR_QUIET OUTPUT_STRIP_TRAILING_WHITESPACE)
    if(code STREQUAL "0")
      set(${result} "${found}" PARENT_SCOPE)
      return()
    endif()
  endforeach()
  set(${result} "" PARENT_SCOPE)
endfunction()

if(GS_WITH_PYTHON)
  find_path(GS_PYBIND11_DIR pybind11/numpy.h)
  gs_find_python(Python3_EXECUTABLE)
  if(GS_PYBIND11_DIR AND Python3_EXECUTABLE)
    find_package(Python3 QUIET COMPONENTS Interpreter Development.Module)
    set(GS_HAVE_PYTHON ${Python3_FOUND})
  endif()
endif()
if(GS_HAVE_PYTHON)
  set(GS_PYTHON_INSTALL_DIR "" CACHE STRING "Where the Python module is installed, below the prefix; empty: lib/pythonX.Y/site-packages")
  if(GS_PYTHON_INSTALL_DIR STREQUAL "")
    set(GS_PYTHON_INSTALL_DIR lib/python${Python3_VERSION_MAJOR}.${Python3_VERSION_MINOR}/site-packages)
  endif()
endif()
gs_report("Python" GS_WITH_PYTHON "${GS_HAVE_PYTHON}" "no Python module is built" "scripts/setup.sh builds the module gemsplat (docs/reference/python.md)" "pybind11-dev, python3-dev and python3-numpy")
