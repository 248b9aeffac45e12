// SPDX-License-Identifier: Apache-2.0
// Arrays in files of the safetensors format, whole and damaged.
#include "gs_core/system/safetensors.h"

#include "tests/support/lpips_file.h"
#include "tests/support/test.h"

namespace gs {
namespace {

class Safetensors : public testing::Test {
 protected:
  SafetensorsFile read(const std::string& bytes) {
    write_bytes(file_, bytes);
    return SafetensorsFile(file_, "do so");
  }
  // A header of its own, and data behind it.
  std::string refusal(const std::string& header, std::size_t data = 8) {
    const std::uint64_t length = header.size();
    const std::string begin(reinterpret_cast<const char*>(&length), sizeof length);
    const std::string error = error_of([&] { read(begin + header + std::string(data, '\0')); });
    EXPECT_THAT(error, AllOf(HasSubstr(file_.string()), HasSubstr("do so"))) << header;
    return error;
  }

  TempFolder folder_;
  const std::filesystem::path file_ = folder_.path() / "a.safetensors";
};

TEST_F(Safetensors, ArraysAreFoundByName) {
  const SafetensorsFile file = read(
      safetensors_bytes({{"b", {{2, 3}, {1, 2, 3, 4, 5, 6}}}, {"a", {{}, {7}}}, {"c", {{0}, {}}}}));
  EXPECT_THAT(file.array("b").values, ElementsAre(1, 2, 3, 4, 5, 6));
  EXPECT_THAT(file.array("b").shape, ElementsAre(2, 3));
  EXPECT_THAT(file.array("a").values, ElementsAre(7));
  EXPECT_TRUE(file.array("c").values.empty());
  EXPECT_TRUE(file.has("a"));
  EXPECT_FALSE(file.has("__metadata__"));
  EXPECT_THAT(error_of([&] { file.array("d"); }), HasSubstr("has no d; do so"));
}

TEST_F(Safetensors, TheHashChangesWithEveryByte) {
  std::string bytes = safetensors_bytes({{"a", {{2}, {1, 2}}}});
  const std::string hash = read(bytes).hash();
  EXPECT_EQ(read(bytes).hash(), hash);
  bytes.back() ^= 1;
  EXPECT_NE(read(bytes).hash(), hash);
}

TEST_F(Safetensors, NumbersOfAnotherKindAreRefusedWhenTheyAreAskedFor) {
  const SafetensorsFile file =
      read(safetensors_bytes({{"a", {{4}, {1, 2}}}}, "F16"));  // 4 numbers in 8 bytes
  EXPECT_THAT(error_of([&] { file.array("a"); }), HasSubstr("of the kind F16 and not F32"));
}

TEST_F(Safetensors, ValuesThatAreNotFiniteAreRefused) {
  for (const float value :
       {std::numeric_limits<float>::infinity(), std::numeric_limits<float>::quiet_NaN()}) {
    const SafetensorsFile file = read(safetensors_bytes({{"a", {{2}, {1, value}}}}));
    EXPECT_THAT(error_of([&] { file.array("a"); }), HasSubstr("not finite"));
  }
}

TEST_F(Safetensors, DamagedHeadersAreRefused) {
  const auto header = [](const std::string& shape, const std::string& offsets) {
    return R"({"a":{"dtype":"F32","shape":)" + shape + R"(,"data_offsets":)" + offsets + "}}";
  };
  EXPECT_THAT(refusal(header("[2]", "[0,12]")), HasSubstr("data of a are missing"));
  EXPECT_THAT(refusal(header("[2]", "[8,4]")), HasSubstr("data of a are missing"));
  EXPECT_THAT(refusal(header("[2]", "[-8,0]")), HasSubstr("data of a are missing"));
  EXPECT_THAT(refusal(header("[3]", "[0,8]")), HasSubstr("do not fit its shape"));
  EXPECT_THAT(refusal(header("[-2]", "[0,8]")), HasSubstr("do not fit its shape"));
  EXPECT_THAT(refusal(header("[4294967296,4294967296,2]", "[0,8]")),
              HasSubstr("do not fit its shape"));
  EXPECT_THAT(refusal(header("[2]", "[0]")), HasSubstr("offsets of a are damaged"));
  refusal(header("2", "[0,8]"));
  for (const char* number : {"0.5", "1e70", "\"0\""}) {
    EXPECT_THAT(refusal(header("[" + std::string(number) + "]", "[0,8]")),
                HasSubstr("whole number"));
    EXPECT_THAT(refusal(header("[2]", "[0," + std::string(number) + "]")),
                HasSubstr("whole number"));
  }
  refusal(R"({"a":{"shape":[2],"data_offsets":[0,8]}})");
  refusal(R"({"a":[)");
  EXPECT_THAT(refusal("[1]"), HasSubstr("no safetensors file"));
  EXPECT_THAT(refusal(""), HasSubstr("no safetensors file"));
}

TEST_F(Safetensors, OtherFilesAreRefused) {
  for (const std::string bytes : {"", "short", "a text that is longer than eight bytes"})
    EXPECT_THAT(error_of([&] { read(bytes); }), HasSubstr("no safetensors file; do so"));
  EXPECT_THAT(error_of([&] { SafetensorsFile(folder_.path() / "none", "do so"); }),
              HasSubstr("there is no such file"));
}

}  // namespace
}  // namespace gs
