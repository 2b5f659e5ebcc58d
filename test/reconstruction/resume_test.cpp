// Runs that were interrupted, failed or were changed go on, or are refused.

#include <sys/stat.h>

#include <algorithm>
#include <filesystem>
#include <string>

#include "reconstruction/run_fixture.h"
#include "support/error_text.h"

namespace acmp {
namespace {

class ResumeTest : public ReconstructRunFixture {
 protected:
  ResumeTest() {
    options_.colmap = true;
    options_.source_views = 3;
  }
  int PassesOfWholeRun() { return RunTo("whole"); }
};

TEST_F(ResumeTest, InterruptedAnywhereEndsWithTheSameBytes) {
  const int passes = PassesOfWholeRun();
  ASSERT_GE(passes, 4 * kImages - 4);
  for (int stop = 0; stop < passes; ++stop) {
    std::filesystem::remove_all(output());
    const size_t begun = RunInterrupted(stop);
    EXPECT_FALSE(Has("summary.json"));
    FakeMatcher second;
    Run(&second);
    EXPECT_THAT(log_.str(), HasSubstr("going on with an interrupted run"));
    ExpectSameContents(output("whole"), output());
    constexpr int kMostRepeated = 2;  // the passes of an image's initial estimate are one step
    EXPECT_LE(static_cast<int>(begun + second.calls.size()), passes + kMostRepeated) << "stopped at " << stop;
  }
}

TEST_F(ResumeTest, FilesThatAreMissingAreMadeAgain) {
  PassesOfWholeRun();
  options_.keep_work = true;
  Run(&fake_);
  for (const char* name : {"summary.json", "depth/000001.png", "pictures/000002_cost.png", "fused.ply",
                           "colmap/images/00000000.png", "colmap/stereo/depth_maps/00000003.png.geometric.bin",
                           "colmap/sparse/0/points3D.bin", "colmap/stereo/fusion.cfg"}) {
    std::filesystem::remove(output() / name);
  }
  options_.keep_work = false;
  FakeMatcher second;
  Run(&second);
  EXPECT_TRUE(second.calls.empty()) << "the passes were there";
  ExpectSameContents(output("whole"), output());
}

TEST_F(ResumeTest, ACompleteRunThatLostFilesIsMadeAgain) {
  for (const char* schedule : {"offline", "online"}) {
    std::filesystem::remove_all(output());
    std::filesystem::remove_all(output("whole"));
    options_.schedule = schedule;
    options_.mapper.window_size = 4;
    options_.mapper.lookahead = 1;
    PassesOfWholeRun();
    Run(&fake_);
    const auto expect_made_again = [&](const std::string& word) {
      FakeMatcher again;
      Run(&again);
      EXPECT_FALSE(again.calls.empty());
      EXPECT_THAT(log_.str(), HasSubstr("warning: " + output().string() + ": was complete, but " + word));
      ExpectSameContents(output("whole"), output());
      Run(&again);
      EXPECT_THAT(out_.str(), HasSubstr("already complete"));
    };
    std::filesystem::remove(output() / "fused.ply");
    expect_made_again("1 of 58 files are missing or have another size: fused.ply is missing; all is written again");
    std::filesystem::resize_file(output() / "depth/000001.pfm", 100);
    std::filesystem::remove_all(output() / "pictures");
    expect_made_again("17 of 58 files are missing or have another size: depth/000001.pfm has 100 of ");
    std::filesystem::remove(output() / "colmap/stereo/depth_maps/00000003.png.geometric.bin");
    expect_made_again("1 of 58 files are missing or have another size: colmap/stereo/depth_maps/00000003");
    WriteText("out/files.txt", "# files\n12 a\nb\n");
    EXPECT_THAT(Error(), HasSubstr("is damaged: \"b\""));
    std::filesystem::remove(output() / "files.txt");
    EXPECT_THAT(Error(), HasSubstr(" was not written by this program")) << "whose they are, nobody knows";
    EXPECT_TRUE(std::filesystem::exists(output() / "depth/000001.pfm"));
  }
}

TEST_F(ResumeTest, WhatOthersHavePutIntoTheFolderStays) {
  options_.colmap = true;
  Run(&fake_);
  const std::vector<std::string> theirs = {"colmap/scene.mvs",    "colmap/fused.ply",  "colmap/images/me.jpg",
                                           "depth/notes.txt",     "depth/999999.png",  "pictures/holiday/me.jpg",
                                           "work/thesis/one.txt", "work/step_0/a.bin", "depth/000777.png/inside"};
  for (const std::string& name : theirs) WriteText("out/" + name, "precious");
  const auto expect_kept = [&] {
    for (const std::string& name : theirs) EXPECT_EQ(ReadText(output() / name), "precious") << name;
  };
  options_.overwrite = true;
  Run(&fake_);
  expect_kept();
  options_.overwrite = false;
  std::filesystem::remove(output() / "depth/000001.pfm");
  Run(&fake_);
  expect_kept();
  WriteText("out/depth/000001.dmb", "precious");
  options_.overwrite = true;
  options_.dmb = true;
  EXPECT_THAT(Error(), HasSubstr("depth/000001.dmb was not written by this program"));
  EXPECT_EQ(ReadText(output() / "depth/000001.dmb"), "precious");
}

TEST_F(ResumeTest, LinksAndPipesInTheFolderAreRefused) {
  Run(&fake_);
  WriteText("elsewhere/000001.pfm", "precious");
  for (const char* name : {"depth", "fused.ply", "work", "run.txt", "summary.json", "files.txt", ".lock"}) {
    for (const bool pipe : {false, true}) {
      SCOPED_TRACE(name);
      const std::filesystem::path path = output() / name, away = output("away");
      if (std::filesystem::exists(path)) std::filesystem::rename(path, away);
      if (pipe) {
        ASSERT_EQ(mkfifo(path.c_str(), 0600), 0);
      } else {
        std::filesystem::create_symlink(folder() / "elsewhere", path);
      }
      for (const bool overwrite : {false, true}) {
        options_.overwrite = overwrite;
        options_.seed = 7;  // not complete
        EXPECT_FALSE(Error().empty());
      }
      EXPECT_EQ(ReadText(folder() / "elsewhere/000001.pfm"), "precious");
      std::filesystem::remove(path);
      if (std::filesystem::exists(away)) std::filesystem::rename(away, path);
      options_.seed = 1;
      options_.overwrite = true;
      Run(&fake_);
    }
  }
}

TEST_F(ResumeTest, OtherSettingsAreRefusedUntilOverwrite) {
  Run(&fake_);
  options_.seed = 7;
  options_.source_views = 2;
  EXPECT_THAT(Error(), AllOf(HasAll("seed was 1 and is 7", "source-views was 3 and is 2", "--overwrite"),
                             Not(HasSubstr("input"))));
  options_.source_views = 3;
  options_.overwrite = true;
  FakeMatcher again;
  Run(&again);
  EXPECT_FALSE(again.calls.empty());
  options_.overwrite = false;
  options_.output = output("fresh");
  Run(&fake_);
  ExpectSameContents(output(), output("fresh"));
  std::filesystem::copy_file(scene() / "images/00000000.png", scene() / "images/00000001.png",
                             std::filesystem::copy_options::overwrite_existing);
  EXPECT_THAT(Error(), HasSubstr("input (hash of images"));
}

TEST_F(ResumeTest, OverwriteRemovesWhatOtherSettingsDoNotMake) {
  Run(&fake_);
  EXPECT_TRUE(Has("colmap") && Has("cost"));
  options_.colmap = false;
  options_.maps = {"depth"};
  EXPECT_THAT(Error(), HasAll("colmap was true and is false", "maps was depth normal cost confidence and is depth"));
  options_.overwrite = true;
  Run(&fake_);
  EXPECT_FALSE(Has("colmap") || Has("cost"));
  EXPECT_TRUE(Has("fused.ply"));
}

TEST_F(ResumeTest, WorkFilesWithDamagedContentAreMadeAgain) {
  PassesOfWholeRun();
  options_.keep_work = true;
  Run(&fake_);
  const auto whole = Contents(output() / "work");
  ASSERT_GE(whole.size(), 4u * kImages);
  const size_t bytes = whole.begin()->second.size();
  // In the header: checksum, length; the size of the maps; the last bit of a cost. Or cut, as by a power failure.
  for (const size_t damaged_byte : {size_t{4}, size_t{8}, size_t{16}, bytes - 1, bytes}) {
    for (const auto& [name, content] : whole) {
      std::string damaged = content;
      if (damaged_byte == bytes) {
        damaged.resize(name.find("000001") != std::string::npos ? 0 : content.size() - 1);
      } else {
        damaged[std::min(damaged_byte, content.size() - 1)] ^= 1;
      }
      WriteText("out/work/" + name, damaged);
    }
    std::filesystem::remove(output() / "summary.json");
    FakeMatcher second;
    Run(&second);
    EXPECT_EQ(second.calls.size(), fake_.calls.size()) << "byte " << damaged_byte;
    EXPECT_THAT(log_.str(), HasSubstr("000002.bin is damaged: its step of image 00000002.png is computed again"));
    EXPECT_TRUE(Contents(output() / "work") == whole) << "byte " << damaged_byte;
    ExpectSameContents(output("whole") / "depth", output() / "depth");
  }
}

TEST_F(ResumeTest, AnInterruptedOnlineRunStartsAnew) {
  options_.schedule = "online";
  options_.mapper.window_size = 4;
  options_.mapper.lookahead = 1;
  const int passes = PassesOfWholeRun();
  for (int stop : {0, 3, passes - 1}) {
    std::filesystem::remove_all(output());
    RunInterrupted(stop);
    EXPECT_FALSE(Has("summary.json"));
    FakeMatcher second;
    Run(&second);
    EXPECT_THAT(log_.str(), HasSubstr("an interrupted run with --schedule online starts anew"));
    EXPECT_EQ(static_cast<int>(second.calls.size()), passes);
    ExpectSameContents(output("whole"), output());
  }
  options_.overwrite = true;
  fake_.on_call = [](int) { throw ProcessingError("device lost"); };
  EXPECT_THAT(MessageOf<ProcessingError>([&] { Run(&fake_); }), HasSubstr("device lost"));
}

}  // namespace
}  // namespace acmp
