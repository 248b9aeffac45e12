# SPDX-License-Identifier: Apache-2.0
# cmake -DBUILD=... -DSCENE=... -DWORK=... -P install_test.cmake: installs the build into WORK/prefix,
# moves the installation to a folder that no path of the build names, and configures, builds and runs
# the installed example there, as users of the library would. COMPILER, LAUNCHER, GENERATOR: those of
# the build; PYTHON, PYTHON_DIR: the interpreter, and the module's folder below the prefix.
function(run what)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE code OUTPUT_VARIABLE output ERROR_VARIABLE output)
  if(NOT code STREQUAL "0")
    message(FATAL_ERROR "${what} failed (${code}):\n${output}")
  endif()
  set(output "${output}" PARENT_SCOPE)
endfunction()

file(REMOVE_RECURSE ${WORK})
run("cmake --install" ${CMAKE_COMMAND} --install ${BUILD} --prefix ${WORK}/first)
file(RENAME ${WORK}/first ${WORK}/prefix)
set(prefix ${WORK}/prefix)

run("the installed program" ${prefix}/bin/gemsplat --version)
run("configuring the example" ${CMAKE_COMMAND} -S ${prefix}/share/gemsplat/example -B ${WORK}/build -G ${GENERATOR}
  -DCMAKE_PREFIX_PATH=${prefix} -DCMAKE_BUILD_TYPE=Release -DCMAKE_CXX_COMPILER=${COMPILER} -DCMAKE_CXX_COMPILER_LAUNCHER=${LAUNCHER}
  -DCMAKE_EXPORT_COMPILE_COMMANDS=ON)
run("building the example" ${CMAKE_COMMAND} --build ${WORK}/build)
run("the example" ${WORK}/build/gemsplat_example ${SCENE} 20 ${WORK}/out)
if(NOT output MATCHES "step 20: loss [0-9.]+, [0-9]+ Gaussians.*dB PSNR on [0-9]+ held-out views")
  message(FATAL_ERROR "the example printed something else:\n${output}")
endif()
foreach(file model.ply model.spz)
  run("gemsplat info ${file}" ${prefix}/bin/gemsplat info ${WORK}/out/${file})
endforeach()
if(NOT EXISTS ${WORK}/out/view.png)
  message(FATAL_ERROR "the example wrote no picture")
endif()

# Nothing of it came from the build's tree or its sources.
file(READ ${WORK}/build/compile_commands.json commands)
file(GLOB package ${prefix}/lib*/cmake/gemsplat/*.cmake ${prefix}/lib*/*/cmake/gemsplat/*.cmake)
foreach(file IN LISTS package)
  file(READ ${file} text)
  string(APPEND commands "${text}")
endforeach()
cmake_path(GET BUILD PARENT_PATH builds)
cmake_path(GET SCENE PARENT_PATH data)
cmake_path(GET data PARENT_PATH source)
foreach(folder gs_core gs_app data_loaders apps/python)
  foreach(place ${source}/${folder} ${BUILD}/${folder})
    string(FIND "${commands}" "${place}" found)
    if(NOT found EQUAL -1)
      message(FATAL_ERROR "the package names ${place}")
    endif()
  endforeach()
endforeach()

if(PYTHON)
  run("the installed Python module" ${CMAKE_COMMAND} -E env PYTHONPATH=${prefix}/${PYTHON_DIR} PYTHONDONTWRITEBYTECODE=1
    ${PYTHON} -c "import gemsplat\nprint(gemsplat.__file__, gemsplat.load('${WORK}/out/model.ply'))")
  if(NOT output MATCHES "${prefix}.*Gaussians, SH degree 3")
    message(FATAL_ERROR "the module is not the installed one:\n${output}")
  endif()
endif()
