// SPDX-License-Identifier: Apache-2.0
// The program starts quickly: libraries that take long to load are loaded when they are needed
// (apps/cli/lazy/modules.h). Running times are measured by scripts/bench_startup.sh, not here.
#include <gmock/gmock.h>

#include <array>
#include <cstdio>
#include <memory>
#include <string>

namespace gs {
namespace {

std::string output_of(const std::string& command) {
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> pipe(popen(command.c_str(), "r"), pclose);
  std::string text;
  std::array<char, 4096> part;
  while (pipe && std::fgets(part.data(), int(part.size()), pipe.get())) text += part.data();
  return text;
}

TEST(Startup, LoadsNoLibraryOfPhotosOrVideos) {
  const std::string libraries = output_of(std::string("ldd ") + GS_PROGRAM);
  ASSERT_THAT(libraries, testing::HasSubstr("libc.so"));
  for (const char* slow : {"OpenImageIO", "opencv_videoio", "avcodec", "gdal"})
    EXPECT_THAT(libraries, testing::Not(testing::HasSubstr(slow)));
}

}  // namespace
}  // namespace gs
