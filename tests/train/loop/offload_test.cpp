// SPDX-License-Identifier: Apache-2.0
// Runs that keep SH in another memory (train.offload), on a backend whose two memories are counted:
// they end with the same bits, and "auto" offloads what fits only so.
#include "gs_train/loop/offload.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "gs_core/error.h"
#include "gs_train/stages/scalar_backend.h"
#include "tests/support/counted_memory.h"
#include "tests/support/scene_run.h"
#include "tests/support/small_scene.h"

namespace gs {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

/// The scalar backend as if it were a device's.
class OffloadingBackend final : public ScalarBackend {
 public:
  Memory& memory() override { return device; }
  Memory* offload_memory() override { return &offload; }
  CountedMemory device, offload;
};

Config with(OffloadMode mode, Config config = busy_run()) {
  config.train.offload = mode;
  return config;
}

/// The most bytes that each memory has after a step, and the steps after which updates were lazy.
class NoteMemory final : public Observer {
 public:
  explicit NoteMemory(OffloadingBackend& backend) : backend_(backend) {}
  void after_step(int step, Trainer& trainer) override {
    on_device = std::max(on_device, backend_.device.allocated);
    offloaded = std::max(offloaded, backend_.offload.allocated);
    if (const TrainingModel& model = trainer.model(); model.memory().offloads_sh()) {
      EXPECT_EQ(backend_.offload.allocated, sh_rest_bytes(model)) << step;
    }
    lazy_steps += trainer.model().lazy.is_on;
  }
  std::size_t on_device = 0, offloaded = 0;
  int lazy_steps = 0;

 private:
  OffloadingBackend& backend_;
};

class OffloadedRun : public ::testing::Test {
 protected:
  TrainingModel trained(const Config& config, NoteMemory* note = nullptr) {
    Trainer trainer(scene_, config, backend_);
    if (note) trainer.add_observer(*note);
    trainer.run();
    return copy_to(host_memory(), trainer.model());
  }
  /// A run that is stopped after a step, and goes on with other settings.
  TrainingModel resumed(const Config& config, int stop, const Config& afterwards) {
    return resumed_after(stop, scene_, config, backend_, afterwards);
  }

  const Scene scene_ = scene_of_two_halves();
  OffloadingBackend backend_;
};

TEST_F(OffloadedRun, EndsWithTheBitsOfARunInOneMemory) {
  for (Config config : {busy_run(), short_mcmc_run()})
    for (const LazyMode lazy : {LazyMode::on, LazyMode::off})
      for (const MomentForm moments : kMomentForms) {
        config.train.iterations = 130;
        config.optimizer.lazy = lazy;
        config.optimizer.moments = moments;
        SCOPED_TRACE(testing::Message() << config.density.strategy << int(lazy) << int(moments));
        NoteMemory whole(backend_), parted(backend_);
        const TrainingModel expected = trained(with(OffloadMode::none, config), &whole);
        EXPECT_TRUE(same_bits(trained(with(OffloadMode::sh, config), &parted), expected));
        EXPECT_EQ(whole.offloaded, 0u);
        EXPECT_GT(parted.offloaded, 0u);
        EXPECT_EQ(parted.on_device + parted.offloaded, whole.on_device);
      }
}

TEST_F(OffloadedRun, UpdatesLazilyUnlessTheUserSaysOtherwise) {
  const auto lazy_steps = [&](OffloadMode offload, LazyMode lazy) {
    Config config = with(offload);
    config.optimizer.lazy = lazy;
    NoteMemory note(backend_);
    trained(config, &note);
    return note.lazy_steps;
  };
  const LazyMode given = Config().optimizer.lazy;
  EXPECT_EQ(lazy_steps(OffloadMode::sh, given), 129);  // all but the last, where all rows catch up
  EXPECT_EQ(lazy_steps(OffloadMode::none, given), 0);
  EXPECT_EQ(lazy_steps(OffloadMode::sh, LazyMode::off), 0);
}

TEST_F(OffloadedRun, GoesOnInOtherMemoryWithTheSameBits) {
  const Config here = with(OffloadMode::none), there = with(OffloadMode::sh);
  const TrainingModel lazy = trained(there), prompt = trained(here);
  EXPECT_FALSE(same_bits(lazy, prompt));
  for (const int stop : {1, 43, 97}) {
    SCOPED_TRACE(stop);
    EXPECT_TRUE(same_bits(resumed(there, stop, there), lazy));
    EXPECT_TRUE(same_bits(resumed(there, stop, here), lazy));
    EXPECT_TRUE(same_bits(resumed(here, stop, there), prompt));
  }
}

TEST_F(OffloadedRun, IsSavedAsItIs) {
  const auto saved = [&](OffloadMode mode) {
    Config config = with(mode);
    config.optimizer.lazy = LazyMode::on;
    config.train.iterations = 50;
    Trainer trainer(scene_, config, backend_);
    trainer.run();
    return trained_model(trainer);
  };
  const GaussianModel whole = saved(OffloadMode::none), parted = saved(OffloadMode::sh);
  EXPECT_TRUE(same_bits(parted.gaussians, whole.gaussians));
}

// The run cannot grow then, and goes on as it is.
TEST_F(OffloadedRun, SurvivesALackOfHostMemory) {
  Config config = with(OffloadMode::sh, short_mcmc_run());
  config.train.iterations = 60;
  Trainer trainer(scene_, config, backend_);
  const std::size_t first = trainer.gaussian_count();
  backend_.offload.most = backend_.offload.allocated;
  trainer.run();
  EXPECT_EQ(trainer.step(), 60);
  EXPECT_LE(trainer.gaussian_count(), std::max<std::size_t>(first, 80));
  EXPECT_EQ(backend_.rows().count_not_finite(trainer.model()), 0u);
}

TEST_F(OffloadedRun, ByItselfOffloadsWhatFitsOnlySo) {
  Config config = with(OffloadMode::automatic, short_mcmc_run());
  config.density.max_gaussians = 2'000'000;
  const auto is_offloaded_with = [&](double mib) {
    backend_.device.free = std::size_t(mib * (1 << 20));
    const Trainer trainer(scene_, config, backend_);
    return const_cast<Trainer&>(trainer).model().memory().offloads_sh();
  };
  TrainingSize size = training_size(config, picture_sizes(scene_.train_views), 2e6);
  const double whole = training_bytes(size) / (1 << 20);
  const double rest = training_bytes(with_offload(size)) / (1 << 20);
  ASSERT_LT(rest, 0.8 * whole);
  EXPECT_FALSE(is_offloaded_with(whole + 1));
  EXPECT_TRUE(is_offloaded_with(whole - 1));
  EXPECT_TRUE(is_offloaded_with(rest / 0.9 + 1));
  EXPECT_FALSE(is_offloaded_with(rest / 0.9 - 1));  // it does not fit so either
  config.train.offload = OffloadMode::none;
  EXPECT_FALSE(is_offloaded_with(whole - 1));
  config.train.offload = OffloadMode::sh;
  EXPECT_TRUE(is_offloaded_with(whole + 1));
}

TEST_F(OffloadedRun, CountsTheGaussiansThatTheRestLeavesRoomFor) {
  backend_.device.free = std::size_t(1) << 30;
  const auto most_with = [&](OffloadMode mode) {
    Config config = with(mode, short_mcmc_run());
    config.density.max_gaussians = kAutoCount;
    const Trainer trainer(scene_, config, backend_);
    return trainer.config().density.max_gaussians;
  };
  EXPECT_EQ(most_with(OffloadMode::automatic), most_with(OffloadMode::none));
  EXPECT_GT(most_with(OffloadMode::sh), 2 * most_with(OffloadMode::none));
}

TEST(Offload, IsRefusedWhereItHasNoMeaning) {
  const std::unique_ptr<Backend> cpu = make_scalar_backend();
  const Scene scene = small_scene();
  try {
    Trainer(scene, with(OffloadMode::sh), *cpu);
    FAIL() << "a CPU has no other memory";
  } catch (const UsageError& error) {
    EXPECT_THAT(error.what(), AllOf(HasSubstr("train.offload=sh"), HasSubstr("on cpu"),
                                    HasSubstr("leave train.offload out")));
  }
  Trainer by_itself(scene, with(OffloadMode::automatic), *cpu);
  EXPECT_FALSE(by_itself.model().memory().offloads_sh());
}

// 45 numbers of 4 bytes, and their moments.
TEST(Offload, CountsTheBytesOfTheLink) {
  TrainingSize size;
  EXPECT_DOUBLE_EQ(link_bytes(size).by_photo, 180);
  EXPECT_DOUBLE_EQ(link_bytes(size).by_update, 540);
  size.is_lazy = true;
  EXPECT_DOUBLE_EQ(link_bytes(size).by_photo, 540);
  size.moment_bytes = 4;
  EXPECT_DOUBLE_EQ(link_bytes(size).by_photo, 360);
  EXPECT_DOUBLE_EQ(link_bytes(size).by_update, 360);
  size.batch = 4;
  EXPECT_DOUBLE_EQ(link_bytes(size).by_photo, 720);
  EXPECT_DOUBLE_EQ(link_bytes(size).by_update, 360);
  size.moment_bytes = 2;
  EXPECT_DOUBLE_EQ(link_bytes(size).by_photo, 2 * 270);
  EXPECT_DOUBLE_EQ(link_bytes(size).by_update, 270);
}

TEST(Offload, SaysWhatItCosts) {
  TrainingSize size = with_offload({});
  size.gaussians = 10e6;
  EXPECT_THAT(text_of_offload(size, true, std::size_t(24) << 30, 27.0),
              AllOf(HasSubstr("fits only so"), HasSubstr("24.0 are free"),
                    HasSubstr("reads 540 bytes"), HasSubstr("540 each way of those"),
                    HasSubstr("at 27.0 GB/s that is 20 and 20 ms for a million")));
  size.is_lazy = false;
  EXPECT_THAT(text_of_offload(size, false, 0, std::nullopt),
              AllOf(HasSubstr("reads 180 bytes"), HasSubstr("540 each way of all"),
                    Not(HasSubstr("GB/s")), Not(HasSubstr("fits only so"))));
}

TEST(Offload, MeasuresTheLink) {
  OffloadingBackend backend;
  EXPECT_GT(link_gb_per_second(backend).value(), 0.01);
  EXPECT_EQ(backend.device.allocated + backend.offload.allocated, 0u);
  backend.offload.most = 1000;
  EXPECT_FALSE(link_gb_per_second(backend));
  EXPECT_FALSE(link_gb_per_second(*make_scalar_backend()));
}

}  // namespace
}  // namespace gs
