#include "acmp_mapping/dataset/output_file.h"

#include <gmock/gmock.h>

#include "acmp_mapping/common/error.h"
#include "dataset/test_folder.h"

namespace acmp {
namespace {

using ::testing::HasSubstr;
using OutputFileTest = TestFolder;

size_t CountFiles(const std::filesystem::path& folder) {
  return std::distance(std::filesystem::directory_iterator(folder), std::filesystem::directory_iterator());
}

TEST_F(OutputFileTest, CommitReplacesTheOldFile) {
  const auto path = WriteText("map", "old");
  WriteFileAtomically(path, "new");
  EXPECT_EQ(ReadText(path), "new");
  EXPECT_EQ(CountFiles(folder()), 1u) << "the temporary file must be gone";
}

TEST_F(OutputFileTest, WithoutCommitTheOldFileStays) {
  const auto path = WriteText("map", "old");
  {
    AtomicFile file(path);
    file.Write("half of the n");
  }
  EXPECT_EQ(ReadText(path), "old");
  EXPECT_EQ(CountFiles(folder()), 1u);
}

TEST_F(OutputFileTest, PlacesAreFilledInAnyOrder) {
  AtomicFile file(folder() / "a");
  file.WriteAt(6, "world", 5);
  file.WriteAt(3, "lo ", 3);
  file.Write("hel");
  file.Commit();
  EXPECT_EQ(ReadText(folder() / "a"), "hello world");
}

TEST_F(OutputFileTest, FullDiskIsReported) {
  if (!std::filesystem::exists("/dev/full")) GTEST_SKIP() << "this system has no /dev/full";
  const auto expect_full = [&](auto write) {
    std::filesystem::create_symlink("/dev/full", folder() / "a.partial");
    AtomicFile file(folder() / "a");
    EXPECT_THAT(MessageOf<ProcessingError>([&] { write(&file); }),
                AllOf(HasSubstr((folder() / "a").string()), HasSubstr("No space left on device")));
  };
  expect_full([](AtomicFile* file) { file->Write(std::string(100000, 'x')); });
  expect_full([](AtomicFile* file) { file->WriteAt(100, "x", 1); });
  expect_full([](AtomicFile* file) {
    file->Write("x");  // stays in the buffer
    file->Commit();
  });
  EXPECT_EQ(CountFiles(folder()), 0u);
}

TEST_F(OutputFileTest, DurableFilesHaveTheSameContent) {
  AtomicFile file(folder() / "map", Durability::kPowerCut);
  file.Write("whole");
  file.Commit();
  EXPECT_EQ(ReadText(folder() / "map"), "whole");
  SyncFolder(folder());
  EXPECT_THAT(MessageOf<ProcessingError>([&] { SyncFolder(folder() / "none"); }), HasSubstr("No such file"));
}

TEST_F(OutputFileTest, UnwritableFolderIsReported) {
  const auto path = Unwritable("map.pfm");
  const std::string message = MessageOf<ProcessingError>([&] { WriteFileAtomically(path, "x"); });
  EXPECT_THAT(message, HasSubstr(path.string()));
  EXPECT_THAT(message, HasSubstr("Not a directory"));
}

TEST_F(OutputFileTest, FolderInTheWayIsReported) {
  std::filesystem::create_directories(folder() / "map" / "inside");
  EXPECT_THAT(MessageOf<ProcessingError>([&] { WriteFileAtomically(folder() / "map", "x"); }),
              HasSubstr("Is a directory"));
}

TEST_F(OutputFileTest, MakeFolderMakesParentsAndReportsFailure) {
  MakeFolder(folder() / "a" / "b");
  EXPECT_TRUE(std::filesystem::is_directory(folder() / "a" / "b"));
  MakeFolder(folder() / "a" / "b");  // already there: fine
  EXPECT_THAT(MessageOf<ProcessingError>([&] { MakeFolder(Unwritable("sub")); }), HasSubstr("Not a directory"));
  EXPECT_THAT(MessageOf<ProcessingError>([&] { MakeFolder(WriteText("plain", "x")); }), HasSubstr("Not a directory"));
}

}  // namespace
}  // namespace acmp
