// SPDX-License-Identifier: Apache-2.0
// What XLA calls for gemsplat/_jax.py. On a GPU it draws on XLA's stream and in memory of XLA. With a
// room for instances the gradient finds what the picture has kept in one array more; without one it
// draws once more. On the CPU the exact renderer is called by way of Python.
#include <pybind11/stl.h>

#include <vector>

#include "apps/python/module.h"
#include "apps/python/operation.h"
#include "apps/python/xla/c_api.h"
#include "gs_app/run/make_backend.h"
#include "gs_core/error.h"

namespace py = pybind11;

namespace gs::python {
namespace {

int g_xla_minor = XLA_FFI_API_MINOR;  // of the interface that the installed jaxlib has

/// A handler's arguments.
class XlaCall {
 public:
  explicit XlaCall(const XLA_FFI_CallFrame& frame)
      : frame_(frame), text_(only_attribute(frame)), settings_(Json::parse(text_)) {}

  const std::string& text() const { return text_; }
  const Json& settings() const { return settings_; }
  std::vector<const XLA_FFI_Buffer*> inputs() const {
    return buffers(frame_.args.args, frame_.args.size);
  }
  std::vector<const XLA_FFI_Buffer*> outputs() const {
    return buffers(frame_.rets.rets, frame_.rets.size);
  }

  void* stream() const {
    XLA_FFI_Stream_Get_Args asked{XLA_FFI_Stream_Get_Args_STRUCT_SIZE, nullptr, frame_.ctx,
                                  nullptr};
    check(frame_.api->XLA_FFI_Stream_Get(&asked));
    return asked.stream;
  }
  int device() const {
    XLA_FFI_DeviceOrdinal_Get_Args asked{XLA_FFI_DeviceOrdinal_Get_Args_STRUCT_SIZE, nullptr,
                                         frame_.ctx, 0};
    check(frame_.api->XLA_FFI_DeviceOrdinal_Get(&asked));
    return asked.device_ordinal;
  }
  void* allocate(std::size_t bytes) const {
    XLA_FFI_DeviceMemory_Allocate_Args asked{XLA_FFI_DeviceMemory_Allocate_Args_STRUCT_SIZE,
                                             nullptr,
                                             frame_.ctx,
                                             bytes,
                                             kXlaAlignment,
                                             nullptr};
    check(frame_.api->XLA_FFI_DeviceMemory_Allocate(&asked));
    return asked.data;
  }
  void free(void* data, std::size_t bytes) const {
    XLA_FFI_DeviceMemory_Free_Args asked{XLA_FFI_DeviceMemory_Free_Args_STRUCT_SIZE, nullptr,
                                         frame_.ctx, bytes, data};
    check(frame_.api->XLA_FFI_DeviceMemory_Free(&asked));
  }

  static constexpr std::size_t kXlaAlignment = 16;  // bytes, the most that can be asked for

 private:
  static std::string only_attribute(const XLA_FFI_CallFrame& frame) {
    GS_CHECK(frame.attrs.size == 1 && frame.attrs.types[0] == XLA_FFI_AttrType_STRING);
    const auto& text = *static_cast<const XLA_FFI_ByteSpan*>(frame.attrs.attrs[0]);
    return {text.ptr, text.len};
  }
  static std::vector<const XLA_FFI_Buffer*> buffers(void** each, std::int64_t count) {
    std::vector<const XLA_FFI_Buffer*> found;
    for (std::int64_t i = 0; i < count; ++i)
      found.push_back(static_cast<const XLA_FFI_Buffer*>(each[i]));
    return found;
  }
  void check(XLA_FFI_Error* error) const {
    if (!error) return;
    XLA_FFI_Error_GetDetails_Args details{XLA_FFI_Error_GetDetails_Args_STRUCT_SIZE, nullptr, error,
                                          nullptr, XLA_FFI_Error_Code_OK};
    frame_.api->XLA_FFI_Error_GetDetails(&details);
    const std::string message = details.message;
    XLA_FFI_Error_Destroy_Args destroyed{XLA_FFI_Error_Destroy_Args_STRUCT_SIZE, nullptr, error};
    frame_.api->XLA_FFI_Error_Destroy(&destroyed);
    throw Error("XLA: " + message, details.errc == XLA_FFI_Error_Code_RESOURCE_EXHAUSTED
                                       ? ExitCode::out_of_memory
                                       : ExitCode::bad_data);
  }

  const XLA_FFI_CallFrame& frame_;
  const std::string text_;
  const Json settings_;
};

/// Memory of XLA that one call takes. What comes later on the stream may have it again.
class XlaScratch {
 public:
  explicit XlaScratch(const XlaCall& call) : call_(call) {}
  ~XlaScratch() {
    for (const auto& [data, bytes] : taken_) {
      try {
        call_.free(data, bytes);
      } catch (const Error&) {  // there is nobody to tell
      }
    }
  }
  XlaScratch(const XlaScratch&) = delete;
  XlaScratch& operator=(const XlaScratch&) = delete;

  void* allocate(std::size_t bytes) {
    constexpr std::size_t kAlignment = 256;  // bytes, as AllocateOnDevice has it
    const std::size_t size = bytes + kAlignment - XlaCall::kXlaAlignment;
    void* const data = call_.allocate(size);
    taken_.emplace_back(data, size);
    const auto address = reinterpret_cast<std::uintptr_t>(data);
    return pointer<void>((address + kAlignment - 1) / kAlignment * kAlignment);
  }

 private:
  const XlaCall& call_;
  std::vector<std::pair<void*, std::size_t>> taken_;
};

std::uintptr_t address_of(const XLA_FFI_Buffer& buffer) {
  if (buffer.dtype != XLA_FFI_DataType_F32 && buffer.dtype != XLA_FFI_DataType_S32)
    throw UsageError("a GPU draws arrays of float32; arrays of float64 are drawn on the CPU");
  return reinterpret_cast<std::uintptr_t>(buffer.data);
}

/// Arrays by the operator's names.
Addresses arrays_named(const Json& names, const std::vector<const XLA_FFI_Buffer*>& buffers) {
  Addresses arrays;
  for (std::size_t i = 0; i < names.size(); ++i) {
    std::size_t row = 1;
    for (std::int64_t axis = 1; axis < buffers[i]->rank; ++axis)
      row *= std::size_t(buffers[i]->dims[axis]);
    const std::uintptr_t address = address_of(*buffers[i]);
    if (const auto name = names[i].get<std::string>(); name == "sh") {
      arrays["sh0"] = {address, row};
      arrays["sh_rest"] = {address + 3 * sizeof(float), row};
    } else {
      arrays[name] = {address, row};
    }
  }
  return arrays;
}

OperatorCall on_gpu(const XlaCall& call, XlaScratch& memory) {
  if (call.settings().at("smooth").get<bool>()) throw UsageError("smooth is for arrays on the CPU");
  const auto allocate = [&memory](std::size_t bytes) { return memory.allocate(bytes); };
  return {call.device(), call.stream(), allocate, allocate};
}

/// The frame in an array of its own: a copy, or the one that lies there.
std::unique_ptr<OperatorFrame> frame_in(const XLA_FFI_Buffer& array, OperatorCall on,
                                        const Operation& operation,
                                        const OperatorFrame* copied = nullptr) {
  auto* next = static_cast<std::byte*>(array.data);
  on.kept = [&next](std::size_t bytes) { return std::exchange(next, next + bytes); };
  return gpu_operator().frame_in(on, operation.input, operation.settings, copied);
}

void draw_on_gpu(const XlaCall& call) {
  XlaScratch memory(call);
  PictureAddresses pictures;
  const auto outputs = call.outputs();
  std::size_t i = 0;
  for (const auto& [name, shape] : call.settings().at("shapes").items())
    pictures[name] = address_of(*outputs[i++]);
  const Operation operation(arrays_named(call.settings().at("arrays"), call.inputs()),
                            call.settings());
  const OperatorCall on = on_gpu(call, memory);
  const auto frame = operation.draw(on, pictures);
  if (i < outputs.size()) frame_in(*outputs[i], on, operation, frame.get());
}

void pull_back_on_gpu(const XlaCall& call) {
  XlaScratch memory(call);
  const Json& names = call.settings().at("arrays");
  const auto inputs = call.inputs();
  Operation operation(arrays_named(names, inputs), call.settings());
  operation.settings.for_backward = true;
  PictureAddresses by_pictures;
  std::size_t i = names.size();
  for (const Json& name : call.settings().at("pulled"))
    by_pictures[name.get<std::string>()] = address_of(*inputs[i++]);
  if (by_pictures.contains("features")) by_pictures["drawn_features"] = address_of(*inputs[i++]);
  const OperatorCall on = on_gpu(call, memory);
  const auto frame =
      i < inputs.size() ? frame_in(*inputs[i], on, operation) : operation.draw(on, {});
  operation.pull_back(on, *frame, by_pictures,
                      arrays_named(call.settings().at("wanted"), call.outputs()));
}

/// Calls a function of gemsplat/_jax.py with the settings, and (address, shape) of each array.
void call_python(const XlaCall& call, const char* function) {
  const py::gil_scoped_acquire acquire;
  const auto listed = [](const std::vector<const XLA_FFI_Buffer*>& buffers) {
    py::list list;
    for (const XLA_FFI_Buffer* buffer : buffers)
      list.append(
          py::make_tuple(reinterpret_cast<std::uintptr_t>(buffer->data),
                         std::vector<std::int64_t>(buffer->dims, buffer->dims + buffer->rank)));
    return list;
  };
  try {
    py::module_::import("gemsplat._jax")
        .attr(function)(call.text(), listed(call.inputs()), listed(call.outputs()));
  } catch (const py::error_already_set& error) {
    throw Error(error.what());
  }
}
void draw_on_cpu(const XlaCall& call) { call_python(call, "draw_on_host"); }
void pull_back_on_cpu(const XlaCall& call) { call_python(call, "pull_back_on_host"); }

XLA_FFI_Error* failed(const XLA_FFI_Api& api, XLA_FFI_Error_Code code, const char* message) {
  XLA_FFI_Error_Create_Args error{XLA_FFI_Error_Create_Args_STRUCT_SIZE, nullptr, message, code};
  return api.XLA_FFI_Error_Create(&error);
}

/// What XLA calls: a function as above, with errors as XLA has them. XLA also asks for the version
/// of the interface.
template <void (*run)(const XlaCall&)>
XLA_FFI_Error* handle(XLA_FFI_CallFrame* frame) {
  if (const auto* asked = frame->extension_start;
      asked && asked->type == XLA_FFI_Extension_Metadata) {
    const auto* with_metadata = reinterpret_cast<const XLA_FFI_Metadata_Extension*>(asked);
    with_metadata->metadata->api_version = {XLA_FFI_Api_Version_STRUCT_SIZE, nullptr,
                                            XLA_FFI_API_MAJOR, g_xla_minor};
    with_metadata->metadata->traits = 0;
    return nullptr;
  }
  try {
    run(XlaCall(*frame));
    return nullptr;
  } catch (const Error& error) {
    return failed(*frame->api,
                  error.code() == ExitCode::out_of_memory ? XLA_FFI_Error_Code_RESOURCE_EXHAUSTED
                  : error.code() == ExitCode::usage       ? XLA_FFI_Error_Code_INVALID_ARGUMENT
                                                          : XLA_FFI_Error_Code_INTERNAL,
                  error.what());
  } catch (const std::exception& error) {
    return failed(*frame->api, XLA_FFI_Error_Code_INTERNAL, error.what());
  }
}

/// The bytes of that one array more.
std::size_t kept_bytes(const py::dict& settings) {
  const Operation operation({}, settings);
  return gpu_operator().kept_bytes(operation.input, operation.settings);
}

/// (name of the target, platform, handler), for jax.ffi.register_ffi_target().
std::vector<py::tuple> jax_targets(int xla_minor) {
  g_xla_minor = xla_minor;
  const auto target = [](const char* name, const char* platform, XLA_FFI_Handler* handler) {
    return py::make_tuple(name, platform,
                          py::capsule(reinterpret_cast<void*>(handler), "xla._CUSTOM_CALL_TARGET"));
  };
  return {target("gemsplat_draw", "CUDA", handle<draw_on_gpu>),
          target("gemsplat_draw", "cpu", handle<draw_on_cpu>),
          target("gemsplat_pull_back", "CUDA", handle<pull_back_on_gpu>),
          target("gemsplat_pull_back", "cpu", handle<pull_back_on_cpu>)};
}

}  // namespace

void bind_jax(py::module_& module) {
  module.def("jax_targets", jax_targets);
  module.def("jax_kept_bytes", kept_bytes);
  module.attr("XLA_VERSION") = py::make_tuple(XLA_FFI_API_MAJOR, XLA_FFI_API_MINOR);
}

}  // namespace gs::python
