// SPDX-License-Identifier: Apache-2.0
// Training step by step for gemsplat/_trainer.py, with a loss and a density strategy of Python. Arrays
// come as addresses, of host memory or of the device's, and what is in them is copied.
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>
#include <spdlog/fmt/fmt.h>

#include <utility>

#include "apps/python/arrays.h"
#include "apps/python/devices.h"
#include "apps/python/progress.h"
#include "apps/python/training.h"
#include "data_loaders/cameras/camera_file.h"
#include "gs_app/checkpoints/resume.h"
#include "gs_app/run/make_backend.h"
#include "gs_app/session/start_model.h"
#include "gs_core/error.h"
#include "gs_eval/lpips/lpips.h"

namespace gs::python {
namespace {

/// Where an array of Python lies.
struct Place {
  std::uintptr_t address;
  bool is_on_host;

  void read(Memory& memory, const void* from, std::size_t bytes) const {
    void* const to = reinterpret_cast<void*>(address);
    is_on_host ? memory.download(to, from, bytes) : memory.copy(to, from, bytes);
  }
  void write(Memory& memory, void* to, std::size_t bytes) const {
    const void* const from = reinterpret_cast<const void*>(address);
    is_on_host ? memory.upload(to, from, bytes) : memory.copy(to, from, bytes);
  }
};

/// The picture and the photo of a step, while a loss is computed.
class StepPicture {
 public:
  StepPicture(const ComparedPicture& compared, Memory& memory)
      : compared_(compared), memory_(memory) {}
  NamedCamera camera() const { return {compared_.name, compared_.camera}; }
  bool has_mask() const { return compared_.photo.mask; }
  // Image (3, H, W), transmittance and depth (H, W) where the loss sees depth; photo (H, W, 3) and,
  // if there is one, mask (H, W).
  void read(const std::vector<Place>& pictures, const std::vector<Place>& photo) const {
    const float* const from[] = {compared_.image, compared_.transmittance, compared_.depth};
    for (std::size_t i = 0; i < pictures.size(); ++i)
      pictures[i].read(memory_, from[i], (i == 0 ? 3 : 1) * pixels() * sizeof(float));
    photo[0].read(memory_, compared_.photo.photo, 3 * pixels());
    if (has_mask()) photo[1].read(memory_, compared_.photo.mask, pixels());
    wait_for(photo[0]);
  }
  // By image, alpha and depth.
  void write(const std::vector<Place>& gradients) const {
    float* const to[] = {compared_.dL_dimage, compared_.dL_dalpha, compared_.dL_ddepth};
    for (std::size_t i = 0; i < gradients.size(); ++i)
      gradients[i].write(memory_, to[i], (i == 0 ? 3 : 1) * pixels() * sizeof(float));
    wait_for(gradients[0]);
  }

 private:
  // Arrays of a device are used on its stream.
  void wait_for(const Place& place) const {
    if (place.is_on_host) compared_.wait();
  }
  std::size_t pixels() const {
    return std::size_t(compared_.camera.width) * std::size_t(compared_.camera.height);
  }

  const ComparedPicture& compared_;
  Memory& memory_;
};

/// A strategy of Python as density control.
class PythonControl final : public DensityControl {
 public:
  /// needs(step) gives words, and after_step(step) changes rows.
  PythonControl(const py::object& needs, const py::object& after_step, const Config& config)
      : DensityControl(0), needs_(needs), after_step_(after_step),
        regularizers_(regularizers_of(config)) {}

  DensityStep of_step(int step) const override {
    DensityStep density{.regularizers = regularizers_};
    const py::gil_scoped_acquire gil;
    for (const py::handle word : needs_(step)) {
      density.gather_statistics = true;
      density.absolute_gradient |= word.cast<std::string>() == "absolute";
    }
    return density;
  }

  // The step is done: what is thrown comes out after all that belongs to it.
  RefineReport after_step(TrainingModel&, Backend& backend, int step) override {
    const py::gil_scoped_acquire gil;
    try {
      after_step_(step);
    } catch (const py::error_already_set&) {
      failure_ = std::current_exception();
    }
    backend.device().make_current();
    return {};
  }
  void rethrow_failure() {
    if (failure_) std::rethrow_exception(std::exchange(failure_, nullptr));
  }

 private:
  const py::object &needs_, &after_step_;
  const Regularizers regularizers_;
  std::exception_ptr failure_;
};

/// What a trainer is doing, for the time of a block.
enum class Doing { nothing, work, strategy };
class During {
 public:
  During(Doing& doing, Doing now) : doing_(doing), before_(std::exchange(doing, now)) {}
  ~During() { doing_ = before_; }
  During(const During&) = delete;
  During& operator=(const During&) = delete;

 private:
  Doing& doing_;
  const Doing before_;
};

/// What gemsplat.Trainer holds. Functions of Python may be None.
class TrainerCore {
 public:
  TrainerCore(const ScenePointer& scene, const std::string& config, const std::string& keywords,
              py::object loss, bool sees_depth, py::object needs, py::object after_step)
      : loss_(std::move(loss)), sees_depth_(sees_depth), needs_(std::move(needs)),
        after_step_(std::move(after_step)) {
    const FilledVerb verb("train", Json::parse(keywords));
    config_ = config_of_run(scene, config, verb);
    check_can_be_called();
    const py::gil_scoped_release release;
    scene_ = scene ? scene : load(config_);
    lpips_ = make_lpips(config_.eval);
    if (lpips_) lpips_->check_sizes(scene_->scene.test_views);
    if (config_.train.threads) set_threads(config_.train.threads);
    const Work work;
    backend_ = make_training_backend(config_.train);
    if (config_.model.start_from.empty())
      trainer_ = std::make_unique<Trainer>(scene_->scene, config_, *backend_);
    else
      trainer_ = std::make_unique<Trainer>(scene_->scene, config_, *backend_,
                                           state_from_model(config_, scene_->scene));
    call_python();
  }
  ~TrainerCore() { close(); }
  TrainerCore(const TrainerCore&) = delete;
  TrainerCore& operator=(const TrainerCore&) = delete;

  /// The trainer between two steps, or while the strategy of Python runs.
  Trainer& trainer() const {
    if (!trainer_) throw UsageError("the trainer is closed; make a new one");
    if (doing_ == Doing::work)
      throw UsageError(
          "the trainer is at work, and can be used when that has ended; a loss uses what it is "
          "given");
    return *trainer_;
  }
  /// The same, between two steps alone.
  Trainer& resting_trainer() const {
    if (doing_ == Doing::strategy)
      throw UsageError("a strategy works on its rows; the next step comes when it has returned");
    return trainer();
  }
  const Scene& scene() const { return scene_->scene; }

  std::shared_ptr<Progress> step() {
    Trainer& trainer = resting_trainer();
    if (is_over_)
      throw UsageError(fmt::format("all {} steps are taken; give more with iterations", steps()));
    if (progress_) progress_->end();
    loss_calls_ = 0;
    const During during(doing_, Doing::work);
    {
      const py::gil_scoped_release release;
      const Work work;
      backend_->device().make_current();
      if (!has_begun_) trainer.begin();
      has_begun_ = true;
      if (!trainer.take()) {
        is_over_ = true;
        trainer.end();
      }
    }
    if (control_) control_->rethrow_failure();
    return progress_ = std::make_shared<Progress>(trainer);
  }
  int steps() const { return trainer().schedule().steps(); }

  // Without the GIL.
  template <class F>
  auto computed(const F& f) const {
    Trainer& trainer = this->trainer();
    const During during(doing_, Doing::work);
    const py::gil_scoped_release release;
    const Work work;
    backend_->device().make_current();
    return f(trainer);
  }
  ModelPointer model() const {
    return computed([](Trainer& trainer) { return model_of(trainer); });
  }
  py::tuple evaluate() const {
    if (scene().test_views.empty())
      throw UsageError("no view is held out to evaluate with; load the scene with eval=True");
    return figures_of(
        computed([&](Trainer& trainer) { return evaluation_of(trainer, lpips_.get()); }));
  }
  void save(const std::filesystem::path& path) const {
    resting_trainer();
    if (is_over_) throw UsageError("a state is saved before the last step; save the model instead");
    computed([&](Trainer& trainer) {
      write_checkpoint(path, trainer.config(), SceneRecord(scene()), trainer.progress(),
                       trainer.model());
    });
  }
  void load_state(const std::filesystem::path& path) {
    resting_trainer();
    const During during(doing_, Doing::work);
    const py::gil_scoped_release release;
    const Work work;
    ResumedRun run{read_checkpoint(path), config_, path};
    check_same_scene(run, SceneRecord(scene()), scene().source);
    if (progress_) progress_->end();
    trainer_.reset();  // two models may not fit
    control_ = nullptr;
    has_begun_ = false;
    trainer_ =
        std::make_unique<Trainer>(scene(), config_, *backend_, std::move(run.checkpoint.state));
    is_over_ = trainer_->step() >= trainer_->schedule().steps();
    call_python();
  }
  void close() {
    if (trainer_) resting_trainer();
    if (progress_) progress_->end();
    const py::gil_scoped_release release;
    trainer_.reset();
    backend_.reset();
  }

  // ---- rows ----

  TrainingModel& rows() const {
    Trainer& trainer = this->trainer();
    backend_->device().make_current();
    return trainer.model_to_change();
  }
  Backend& backend() const { return *backend_; }
  const Config& config() const { return trainer().config(); }

  /// The column of a parameter or a statistic.
  ByteBuffer& column(const std::string& name) const {
    for (const Column& column : rows().columns())
      if (column.role != RowRole::moment && column.name == name) return *column.rows;
    throw UsageError("rows have no " + name);
  }
  void read(const std::string& name, const Place& to) const {
    const ByteBuffer& rows = column(name);
    to.read(rows.memory(), rows.bytes(), rows.size_bytes());
    backend_->synchronize(this->rows());
  }
  void write(const std::string& name, const Place& from, std::size_t first) const {
    ByteBuffer& rows = column(name);
    from.write(rows.memory(), rows.row(first), (rows.size() - first) * rows.row_bytes());
    backend_->synchronize(this->rows());
  }
  void apply(const ByteArray& actions, unsigned parts) const {
    const auto* const first = reinterpret_cast<const GrowthAction*>(actions.data());
    SplitRules split;
    split.parts = parts;
    TrainingModel& model = rows();
    backend_->rows().apply(model, {first, std::size_t(actions.size())}, split, config().train.seed,
                           trainer().step());
  }
  using Numbers = py::array_t<std::uint32_t, py::array::c_style | py::array::forcecast>;
  void replace(const Numbers& dead, const Numbers& source) const {
    TrainingModel& model = rows();
    backend_->rows().replace(model, {dead.data(), std::size_t(dead.size())},
                             {source.data(), std::size_t(source.size())},
                             config().density.prune_opacity);
  }
  void append(std::size_t count) const {
    TrainingModel& model = rows();
    const std::size_t before = model.count();
    resize_rows(model, before + count);
    for (const Column& column : model.columns()) column.rows->zero_from(before);
  }

 private:
  void check_can_be_called() const {
    if (loss_.is_none() && after_step_.is_none()) return;
    if (config_.train.ranks > 1)
      throw UsageError("a loss or a strategy of Python trains on one GPU; leave train.ranks at 1");
    if (!loss_.is_none() && config_.photometric.model != "none")
      throw UsageError(
          "a loss of Python gets the picture as it is drawn; set photometric.model to none");
  }

  // The trainer has chosen what the settings name.
  void call_python() {
    if (!loss_.is_none())
      backend_->use(
          {config_.loss.kind,
           nullptr,
           {[this](const ComparedPicture& compared) { return compare(compared); }, sees_depth_,
            [this] {
              const py::gil_scoped_acquire gil;
              return double(py::float_(value_));  // of a tensor, for which the host waits
            }}});
    if (after_step_.is_none()) return;
    auto control = std::make_unique<PythonControl>(needs_, opened_, config_);
    control_ = control.get();
    trainer_->control_density_by(std::move(control));
  }

  double compare(const ComparedPicture& compared) {
    const py::gil_scoped_acquire gil;
    const auto picture = std::make_shared<StepPicture>(compared, backend_->memory());
    const int step = trainer_->step() + 1 + loss_calls_++ % config_.train.batch;
    value_ = loss_(picture, step);
    backend_->device().make_current();  // the loss may have used another GPU
    return 0;
  }

  ScenePointer scene_;
  Config config_;
  const py::object loss_;
  py::object value_ = py::float_(0.0);  // that it has returned last
  const bool sees_depth_;
  const py::object needs_, after_step_;
  // after_step_, while rows can be used
  const py::object opened_ = py::cpp_function([this](int step) {
    const During during(doing_, Doing::strategy);
    after_step_(step);
  });
  std::unique_ptr<Lpips> lpips_;
  std::unique_ptr<Backend> backend_;
  std::unique_ptr<Trainer> trainer_;
  PythonControl* control_ = nullptr;
  std::shared_ptr<Progress> progress_;
  bool has_begun_ = false, is_over_ = false;
  mutable Doing doing_ = Doing::nothing;
  int loss_calls_ = 0;  // in this step
};

}  // namespace

void bind_trainer(py::module_& module) {
  py::class_<Place>(module, "Place").def(py::init<std::uintptr_t, bool>());
  py::class_<StepPicture, std::shared_ptr<StepPicture>>(module, "StepPicture")
      .def_property_readonly("camera", &StepPicture::camera)
      .def_property_readonly("has_mask", &StepPicture::has_mask)
      .def("read", &StepPicture::read)
      .def("write", &StepPicture::write);
  py::class_<TrainerCore> core(module, "TrainerCore");
  core.def(py::init<ScenePointer, const std::string&, const std::string&, py::object, bool,
                    py::object, py::object>())
      .def("step", &TrainerCore::step)
      .def("model", &TrainerCore::model)
      .def("evaluate", &TrainerCore::evaluate)
      .def("save", &TrainerCore::save)
      .def("load", &TrainerCore::load_state)
      .def("close", &TrainerCore::close)
      .def("read", &TrainerCore::read)
      .def("write", &TrainerCore::write)
      .def("apply", &TrainerCore::apply)
      .def("replace", &TrainerCore::replace)
      .def("append", &TrainerCore::append)
      .def("lower_opacity",
           [](const TrainerCore& self, float maximum) {
             TrainingModel& model = self.rows();
             self.backend().rows().reset_opacity(model, maximum);
           })
      .def("clear_statistics",
           [](const TrainerCore& self) { clear_columns(self.rows(), RowRole::statistic); });
  const auto known = [&](const char* name, auto value) { core.def_property_readonly(name, value); };
  known("steps", &TrainerCore::steps);
  known("steps_done", [](const TrainerCore& self) { return self.trainer().step(); });
  known("count", [](const TrainerCore& self) { return self.trainer().gaussian_count(); });
  known("extent", [](const TrainerCore& self) { return self.scene().extent; });
  known("seed", [](const TrainerCore& self) { return self.config().train.seed; });
  known("device", [](const TrainerCore& self) { return self.trainer().backend().name(); });
  known("stream", [](const TrainerCore& self) {
    return reinterpret_cast<std::uintptr_t>(self.backend().device().stream());
  });
  known("moves", [](const TrainerCore& self) { return self.config().model.dynamic; });
}

}  // namespace gs::python
