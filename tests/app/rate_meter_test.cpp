// SPDX-License-Identifier: Apache-2.0
// Rates of long jobs: resumed ones, ones that go back to a checkpoint, and ones with rare reports.
#include "gs_app/run/rate_meter.h"

#include <gtest/gtest.h>

#include "gs_app/run/progress_bar.h"

namespace gs {
namespace {

TEST(RateMeter, StepsBeforeAResumeAreNoSpeed) {
  RateMeter meter(5000, 10.0);  // resumed at step 5,000
  EXPECT_EQ(meter.rate(), 0);
  meter.note(5012, 11.0);
  EXPECT_DOUBLE_EQ(meter.rate(), 12);
}

TEST(RateMeter, NotesThatAreMinutesApartAreEachAMeasurementOfTheirOwn) {
  RateMeter meter(0, 0);
  meter.note(10000, 100);  // 100 a second
  meter.note(11000, 200);  // then 10 a second, since Gaussians were added
  EXPECT_NEAR(meter.rate(), 10, 1e-9);
}

TEST(RateMeter, NotesThatAreCloseTogetherAreSmoothed) {
  RateMeter meter(0, 0);
  meter.note(20, 0.2);
  meter.note(21, 0.4);  // one slow moment: 5 a second after 100 a second
  EXPECT_GT(meter.rate(), 85);
  EXPECT_LT(meter.rate(), 100);
}

TEST(RateMeter, AJobThatGoesBackKeepsItsRateAndIsMeasuredFromThere) {
  RateMeter meter(0, 0);
  meter.note(100, 10);
  meter.note(40, 11);  // back to a checkpoint
  EXPECT_DOUBLE_EQ(meter.rate(), 10);
  meter.note(140, 21);
  EXPECT_NEAR(meter.rate(), 10, 1e-9);
}

TEST(ProgressLine, KeepsTheTimeLeftAndShrinksTheBarFirst) {
  const ProgressFigures figures = {"370/600", "loss 0.0586 | 3,436 Gaussians",
                                   "73.5 step/s | 0:03 left"};
  EXPECT_EQ(progress_line(0.5, figures, 120),
            "[============            ] 370/600 | loss 0.0586 | 3,436 Gaussians | 73.5 step/s | "
            "0:03 left");
  for (const std::size_t columns : {79, 68, 60, 40}) {
    const std::string line = progress_line(0.5, figures, columns);
    EXPECT_LE(line.size(), columns);
    EXPECT_TRUE(line.ends_with(" | 0:03 left")) << line;
  }
  EXPECT_EQ(progress_line(0.5, figures, 79),
            "[=====      ] 370/600 | loss 0.0586 | 3,436 Gaussians | 73.5 step/s | 0:03 left");
  EXPECT_EQ(progress_line(1, {"9/9", "", "1.0 view/s | 0:00 left"}, 20).size(), 20u);
}

}  // namespace
}  // namespace gs
