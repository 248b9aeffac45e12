# SPDX-License-Identifier: Apache-2.0
"""Writes a ninja file for the extensions of both peers and runs it: build.py FOLDER JOBS."""
import glob
import os
import shutil
import subprocess
import sys
import sysconfig

import torch
from torch.utils import cpp_extension

root, jobs = os.path.abspath(sys.argv[1]), sys.argv[2]
arch = os.environ.get("PEERS_ARCH", "90")
try:
    includes = cpp_extension.include_paths(device_type="cuda")
except TypeError:
    includes = cpp_extension.include_paths(cuda=True)
nvcc = shutil.which("nvcc") or "/usr/local/cuda/bin/nvcc"
cuda = os.path.dirname(os.path.dirname(os.path.realpath(nvcc)))
site = os.path.dirname(os.path.dirname(torch.__file__))
includes += [sysconfig.get_paths()["include"], cuda + "/include", cuda + "/include/cccl",
             *glob.glob(cuda + "/targets/x86_64-linux/include"),
             *glob.glob(site + "/nvidia/cu13/include"), *glob.glob(site + "/nvidia/cu13/include/cccl")]
includes = list(dict.fromkeys(p for p in includes if os.path.isdir(p)))
runtime = [p for pattern in ("/lib64/libcudart.so", "/targets/x86_64-linux/lib/libcudart.so")
           for p in glob.glob(cuda + pattern)] + glob.glob(site + "/nvidia/cu13/lib/libcudart.so*")
libraries = os.path.join(os.path.dirname(torch.__file__), "lib")
abi = int(torch._C._GLIBCXX_USE_CXX11_ABI)
suffix = sysconfig.get_config_var("EXT_SUFFIX")

FAST = "-O3 --use_fast_math"
gggs, rade = f"{root}/gggs/submodules", f"{root}/rade/submodules"
glm = f"-I{root}/glm"
modules = [  # folder, sources, flags of nvcc, where it goes, the module's own name
    (f"{gggs}/diff-gaussian-rasterization",
     ["cuda_rasterizer/rasterizer_impl.cu", "cuda_rasterizer/render_forward.cu",
      "cuda_rasterizer/render_backward.cu", "cuda_rasterizer/sample_forward.cu",
      "cuda_rasterizer/sample_backward.cu", "rasterize_points.cu", "ext.cpp"],
     f"{FAST} --extended-lambda --expt-relaxed-constexpr {glm}",
     f"{root}/site/gggs/diff_gaussian_rasterization", "_C"),
    (f"{rade}/diff-gaussian-rasterization",
     ["cuda_rasterizer/rasterizer_impl.cu", "cuda_rasterizer/forward.cu",
      "cuda_rasterizer/backward.cu", "rasterize_points.cu", "ext.cpp"],
     glm, f"{root}/site/rade/diff_gaussian_rasterization", "_C"),
    (f"{gggs}/warp-patch-ncc",
     ["cuda_warp_patch_ncc/warp_patch_ncc_impl.cu", "warp_patch_ncc.cu", "ext.cpp"], FAST,
     f"{root}/site/gggs/warp_patch_ncc", "_C"),
    (f"{gggs}/simple-knn", ["spatial.cu", "simple_knn.cu", "ext.cpp"], "",
     f"{root}/site/both/simple_knn", "_C"),
    (f"{root}/fused-ssim", ["ssim.cu", "ssim3d.cu", "ext.cpp"],
     "-O3 -DFUSED_SSIM_CUDA --maxrregcount=32 --use_fast_math", f"{root}/site/both",
     "fused_ssim_cuda"),
]


def ninja_file(standard):
    common = f"-D_GLIBCXX_USE_CXX11_ABI={abi} -DTORCH_API_INCLUDE_EXTENSION_H -std={standard} " \
             "-include cfloat -include cstdint " + " ".join(f"-I{p}" for p in includes)
    lines = [
        "rule cu", f"  command = {nvcc} {' '.join(cpp_extension.COMMON_NVCC_FLAGS)} {common} "
        f"-gencode=arch=compute_{arch},code=sm_{arch} -Xcompiler -fPIC -DTORCH_EXTENSION_NAME=$name "
        "-I$folder $flags -MD -MF $out.d -c $in -o $out",
        "  depfile = $out.d", "rule cpp", f"  command = g++ -O2 -fPIC {common} "
        "-DFUSED_SSIM_CUDA -DTORCH_EXTENSION_NAME=$name -I$folder -c $in -o $out",
        "rule link", f"  command = g++ -shared $in -o $out -L{libraries} -lc10 -lc10_cuda "
        f"-ltorch_cpu -ltorch_cuda -ltorch -ltorch_python {' '.join(runtime[:1])} "
        f"-Wl,-rpath,{libraries}"]
    results = []
    for folder, sources, flags, where, name in modules:
        objects = []
        for source in sources:
            object_file = f"{root}/build/{folder[len(root) + 1:].replace('/', '_')}/{source}.o"
            rule = "cu" if source.endswith(".cu") else "cpp"
            lines += [f"build {object_file}: {rule} {folder}/{source}", f"  name = {name}",
                      f"  folder = {folder}", f"  flags = {flags}"]
            objects.append(object_file)
        result = f"{where}/{name}{suffix}"
        lines.append(f"build {result}: link {' '.join(objects)}")
        results.append(result)
    return "\n".join(lines) + f"\ndefault {' '.join(results)}\n"


print(f"torch {torch.__version__}, {nvcc}, cudart {runtime[:1]}, sm_{arch}", flush=True)
ninja = shutil.which("ninja") or os.path.join(os.path.dirname(sys.executable), "ninja")

def without_old_names():
    """Newer versions of torch may lack Tensor::data<T>(), which is data_ptr<T>()."""
    for folder, sources, *_ in modules:
        for path in (f"{folder}/{source}" for source in sources):
            with open(path) as file:
                text = file.read()
            if ".data<" in text:
                with open(path, "w") as file:
                    file.write(text.replace(".data<", ".data_ptr<"))


for standard in ("c++17", "c++20"):
    with open(f"{root}/build.ninja", "w") as file:
        file.write(ninja_file(standard))
    if subprocess.run([ninja, "-k", "0", "-j", jobs, "-f", f"{root}/build.ninja"]).returncode == 0:
        break
    print(f"NOT BUILT with {standard}; again without Tensor::data", flush=True)
    without_old_names()
else:
    sys.exit("the extensions were not built")
for folder, sources, flags, where, name in modules:  # the Python halves of the packages
    package = os.path.join(folder, os.path.basename(where), "__init__.py")
    if os.path.exists(package):
        shutil.copy(package, where)
os.makedirs(f"{root}/site/both/fused_ssim", exist_ok=True)
shutil.copy(f"{root}/fused-ssim/fused_ssim/__init__.py", f"{root}/site/both/fused_ssim")
for peer in ("gggs", "rade"):  # each must load beside torch
    code = "import torch, diff_gaussian_rasterization._C, simple_knn._C" + \
           (", warp_patch_ncc._C, fused_ssim" if peer == "gggs" else "")
    path = f"{root}/site/{peer}:{root}/site/both"
    subprocess.run([sys.executable, "-c", code], check=True, env={**os.environ, "PYTHONPATH": path})
    print(peer, "loads", flush=True)
