#include "acmp_mapping/dataset/output_file.h"
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <thread>
#include <vector>

#include "acmp_mapping/dataset/folder_record.h"
#include "acmp_mapping/dataset/scene.h"
#include "dataset/test_folder.h"
#include "support/error_text.h"

namespace {
std::vector<ino_t> g_synced;
}  // namespace

/// In place of the system's, which nobody can see the effect of without a power cut.
extern "C" int fsync(int descriptor) {
  struct stat status = {};
  if (fstat(descriptor, &status) != 0) return -1;
  g_synced.push_back(status.st_ino);
  return 0;
}

namespace acmp {
namespace {

using OutputFileTest = TestFolder;

size_t CountFiles(const std::filesystem::path& folder) {
  return std::distance(std::filesystem::directory_iterator(folder), std::filesystem::directory_iterator());
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

TEST_F(OutputFileTest, APowerCutLeavesTheOldFileOrTheNewOne) {
  const auto inode = [](const std::filesystem::path& path) {
    struct stat status = {};
    return stat(path.c_str(), &status) == 0 ? status.st_ino : 0;
  };
  g_synced.clear();
  WriteFileAtomically(folder() / "map", "new", Durability::kPowerCut);
  EXPECT_THAT(g_synced, ElementsAre(inode(folder() / "map"), inode(folder()))) << "content, then its name";
}

TEST_F(OutputFileTest, AFolderIsWholeOrAbsentAndReplacesTheOldOne) {
  const std::filesystem::path path = folder() / "model";
  const auto write = [&](const std::string& content, bool commit) {
    AtomicFolder made(path, {content});
    WriteFileAtomically(made.temporary_path() / content, content);
    EXPECT_FALSE(std::filesystem::exists(path / content));
    if (commit) made.Commit();
  };
  write("first", false);
  EXPECT_EQ(CountFiles(folder()), 0u);
  WriteText(std::string("model.acmp.partial/") + FolderRecord::kName, "- left_by_a_killed_process\n");
  WriteText("model.acmp.partial/left_by_a_killed_process", "");
  write("first", true);
  EXPECT_EQ(CountFiles(path), 2u);
  write("second", false);
  EXPECT_EQ(ReadText(path / "first"), "first");
  write("second", true);
  EXPECT_EQ(ReadText(path / "second"), "second");
  EXPECT_EQ(CountFiles(path), 2u);
  EXPECT_EQ(CountFiles(folder()), 1u);
  EXPECT_REFUSED(AtomicFolder(folder() / "none/model", {}), "there is no folder");
  EXPECT_THAT(MessageOf<ProcessingError>([&] { AtomicFolder("/proc/model", {}); }),
              HasSubstr("/proc/model.acmp.partial"));
}

TEST_F(OutputFileTest, NothingForeignInAFolderGoes) {
  const std::filesystem::path path = folder() / "model", other = folder() / "elsewhere";
  const auto make = [&] {
    AtomicFolder made(path, {"a/1"});
    MakeFolder(made.temporary_path() / "a");
    WriteFileAtomically(made.temporary_path() / "a/1", "1");
    made.Commit();
  };
  WriteText("model/photo.raw", "precious");
  EXPECT_REFUSED(make(), "photo.raw");
  std::filesystem::rename(path, folder() / "model.acmp.partial");
  EXPECT_REFUSED(make(), "photo.raw");
  EXPECT_EQ(ReadText(folder() / "model.acmp.partial/photo.raw"), "precious");
  std::filesystem::rename(folder() / "model.acmp.partial", other);
  make();
  make();
  std::filesystem::create_directory_symlink(other, path / "a/linked");
  EXPECT_REFUSED(make(), "a/linked");
  std::filesystem::remove(path / "a/linked");
  std::filesystem::remove(path / "a/1");
  std::filesystem::create_symlink(other / "photo.raw", path / "a/1");
  EXPECT_REFUSED(make(), "a/1");
  std::filesystem::remove(path / "a/1");
  ASSERT_EQ(::mkfifo((path / "a/1").c_str(), 0600), 0);
  EXPECT_REFUSED(make(), "a/1");
  std::filesystem::remove_all(path);
  std::filesystem::create_directory_symlink(other, path);
  EXPECT_REFUSED(make(), "model");
  EXPECT_EQ(ReadText(other / "photo.raw"), "precious");
}

TEST_F(OutputFileTest, ARecordSaysWhoseFilesAre) {
  WriteText("old", "theirs");
  FolderRecord record(folder());
  EXPECT_REFUSED(record.Claim({"old"}), "old was not written by this program");
  record.Claim({"depth/1.pfm", "new"});
  WriteText("depth/1.pfm", "ours");
  WriteText("depth/2.pfm", "theirs");
  WriteText("depth/1.pfm.acmp.partial", "of a killed process");
  WriteText("depth/1.pfm.2.acmp.partial", "of another");
  FolderRecord again(folder());
  again.Claim({"depth/1.pfm", "more"});
  EXPECT_EQ(again.files().size(), 3u);
  again.NoteBytes();
  EXPECT_THAT(FolderRecord(folder()).files(), ElementsAre(::testing::Pair("depth/1.pfm", std::optional<uintmax_t>(4))));
  again.RemoveFiles();
  EXPECT_EQ(CountFiles(folder() / "depth"), 1u);
  EXPECT_EQ(ReadText(folder() / "depth/2.pfm"), "theirs");
  EXPECT_EQ(ReadText(folder() / "old"), "theirs");
  WriteText(FolderRecord::kName, "4 ../outside\n");
  EXPECT_REFUSED(FolderRecord{folder()}, "is damaged");
  std::filesystem::remove(folder() / FolderRecord::kName);
  ASSERT_EQ(::mkfifo((folder() / FolderRecord::kName).c_str(), 0600), 0);
  EXPECT_REFUSED(FolderRecord{folder()}, "must be a file");
}

TEST_F(OutputFileTest, AnEndlessRecordIsRefused) {
  std::filesystem::resize_file(WriteText(FolderRecord::kName, ""), uintmax_t{1} << 40);
  EXPECT_REFUSED(FolderRecord{folder()}, FolderRecord::kName, "1099511627776 bytes");
}

TEST_F(OutputFileTest, ProcessesOfOneRunMayClaimTheSameAtOnce) {
  FolderRecord one(folder()), other(folder());
  one.Claim({"a", "b"});
  WriteText("a", "ours");
  other.Claim({"a", "b"});
  EXPECT_EQ(FolderRecord(folder()).files().size(), 2u);
}

TEST_F(OutputFileTest, AFileWithASecondNameIsNotWrittenTo) {
  const auto other = WriteText("other", "precious");
  std::filesystem::create_hard_link(other, folder() / "map.acmp.partial");
  WriteFileAtomically(folder() / "map", "new");
  EXPECT_EQ(ReadText(other), "precious");
  EXPECT_EQ(ReadText(folder() / "map"), "new");
}

TEST_F(OutputFileTest, WhatTheSystemDoesNotTakeIsReported) {
  const auto expect_refused = [&](auto write) {
    AtomicFile file(folder() / "a");
    const FileSizeLimit limit(0);
    EXPECT_THAT(MessageOf<ProcessingError>([&] { write(&file); }), HasAll((folder() / "a").string(), "File too large"));
  };
  expect_refused([](AtomicFile* file) { file->Write(std::string(100000, 'x')); });
  expect_refused([](AtomicFile* file) {
    file->Write("x");  // stays in the buffer
    file->Commit();
  });
  EXPECT_EQ(CountFiles(folder()), 0u);
}

TEST_F(OutputFileTest, TooManyOpenFilesAreReported) {
  rlimit limit = {};
  ASSERT_EQ(getrlimit(RLIMIT_NOFILE, &limit), 0);
  AtomicFile file(folder() / "a");
  const int next = dup(0);
  close(next);
  const rlimit none_left = {static_cast<rlim_t>(next), limit.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &none_left), 0);
  const std::string message = MessageOf<ProcessingError>([&] { file.Commit(); });
  setrlimit(RLIMIT_NOFILE, &limit);
  EXPECT_THAT(message, HasAll((folder() / "a").string(), "Too many open files"));
}

TEST_F(OutputFileTest, ManyWritersAtOnceLeaveWholeFiles) {
  const auto path = folder() / "map";
  std::vector<std::thread> writers;
  for (char letter = 'a'; letter < 'e'; ++letter) {
    writers.emplace_back([&path, letter] {
      for (int i = 0; i < 50; ++i) WriteFileAtomically(path, std::string(10000, letter));
    });
  }
  for (std::thread& writer : writers) writer.join();
  const std::string text = ReadText(path);
  EXPECT_EQ(text, std::string(10000, text.empty() ? '?' : text[0]));
  EXPECT_EQ(CountFiles(folder()), 1u);
}

TEST_F(OutputFileTest, WhatAKilledProcessLeftIsUsedAgain) {
  WriteText("map.acmp.partial", "a longer text that was never finished");
  WriteFileAtomically(folder() / "map", "new");
  EXPECT_EQ(ReadText(folder() / "map"), "new");
  EXPECT_EQ(CountFiles(folder()), 1u);
}

TEST_F(OutputFileTest, LinksInPlaceOfTheTemporaryFileAreNotFollowed) {
  const auto other = WriteText("other", "precious");
  std::filesystem::create_symlink(other, folder() / "map.acmp.partial");
  EXPECT_THAT(MessageOf<ProcessingError>([&] { WriteFileAtomically(folder() / "map", "x"); }),
              HasSubstr("map.acmp.partial: Too many levels of symbolic links"));
  EXPECT_EQ(ReadText(other), "precious");
}

TEST_F(OutputFileTest, PipesAreNotWaitedFor) {
  ASSERT_EQ(::mkfifo((folder() / "map.acmp.partial").c_str(), 0600), 0);
  EXPECT_THROW(WriteFileAtomically(folder() / "map", "new"), ProcessingError);
  ASSERT_EQ(::mkfifo((folder() / "mask.png").c_str(), 0600), 0);
  for (const std::filesystem::path& path : {folder() / "mask.png", std::filesystem::path("/dev/zero")}) {
    EXPECT_REFUSED(ReadMask(path), "is a device, pipe or socket") << path;
  }
}

TEST_F(OutputFileTest, ReservedSpaceIsNotPartOfTheFile) {
  AtomicFile file(folder() / "map");
  file.Reserve(1 << 20);
  file.Write("new");
  file.Commit();
  EXPECT_EQ(ReadText(folder() / "map"), "new");
  struct stat status = {};
  ASSERT_EQ(::stat((folder() / "map").c_str(), &status), 0);
  EXPECT_LT(status.st_blocks * 512, 1 << 20) << "nor does it stay reserved";
}

TEST_F(OutputFileTest, OnlyRegularFilesAreReplaced) {
  ASSERT_EQ(mkfifo((folder() / "pipe").c_str(), 0600), 0);
  EXPECT_REFUSED(WriteFileAtomically(folder() / "pipe", "x"), "pipe");
  EXPECT_TRUE(std::filesystem::is_fifo(folder() / "pipe"));
  EXPECT_REFUSED(WriteFileAtomically(folder() / std::string("nul\0.ply", 8), "x"), "zero character");
}

TEST_F(OutputFileTest, MakeFolderMakesParentsAndReportsFailure) {
  MakeFolder(folder() / "a" / "b");
  EXPECT_TRUE(std::filesystem::is_directory(folder() / "a" / "b"));
  MakeFolder(folder() / "a" / "b");  // already there: fine
  EXPECT_REFUSED(MakeFolder(Unwritable("sub")), "Not a directory");
  EXPECT_REFUSED(MakeFolder(WriteText("plain", "x")), "Not a directory");
}

}  // namespace
}  // namespace acmp
