BEGIN TRANSACTION;
CREATE TABLE alembic_version (
	version_num VARCHAR(32) NOT NULL, 
	CONSTRAINT alembic_version_pkc PRIMARY KEY (version_num)
);
INSERT INTO "alembic_version" VALUES('0002');
CREATE TABLE policies (
	id INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT, 
	run INTEGER NOT NULL, 
	task TEXT NOT NULL, 
	domain TEXT NOT NULL, 
	method TEXT NOT NULL, 
	seed INTEGER NOT NULL, 
	frames INTEGER NOT NULL, 
	program TEXT NOT NULL, 
	checkpoint TEXT NOT NULL, 
	success_rate FLOAT NOT NULL, 
	mean_score FLOAT NOT NULL, 
	mean_length FLOAT NOT NULL, 
	crispness FLOAT NOT NULL, 
	created TEXT NOT NULL, 
	metadata TEXT NOT NULL, 
	CONSTRAINT fk_policies_run FOREIGN KEY(run) REFERENCES runs (id)
);
INSERT INTO "policies" VALUES(1,1,'BlockedDoor','minigrid','hdm',0,1000,'0.98 :: gt_key() :- !has_key(agent), has_key(env)','a8685281be6a292296ef270f4045ce124f66aeedbd47c76570448e9713a0f8ab',0.97,0.93,30.25,0.96,'2026-11-25T08:45:05.613+00:00','{"heads": ["gt_key()"], "note": "\u00e9\u2028\u0001"}');
INSERT INTO "policies" VALUES(2,2,'GapBall','minigrid','hdm',1,1000,'1e-05 :: gt_box() :- !has_key(env)
0.99 :: gt_key() :- has_key(env)','46dd832528a99c34623bdf542aacd5b3e3df23a656106099579f44238b8a0501',0.97,0.93,30.25,0.96,'2026-11-25T08:45:05.705+00:00','{"heads": ["gt_key()"], "note": "\u00e9\u2028\u0001"}');
CREATE TABLE runs (
	id INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT, 
	kind TEXT NOT NULL, 
	method TEXT NOT NULL, 
	task TEXT NOT NULL, 
	scenario TEXT, 
	sources TEXT NOT NULL, 
	seed INTEGER NOT NULL, 
	status TEXT NOT NULL, 
	settings TEXT NOT NULL, 
	versions TEXT NOT NULL, 
	frames INTEGER NOT NULL, 
	episodes INTEGER NOT NULL, 
	seconds FLOAT NOT NULL, 
	results TEXT NOT NULL, 
	created TEXT NOT NULL, 
	finished TEXT
, resumes INTEGER DEFAULT '0' NOT NULL);
INSERT INTO "runs" VALUES(1,'train','hdm','BlockedDoor',NULL,'[]',1099511627776,'finished','{"frames": 130000, "hybrid": {"lanes": 64}}','{"python": "3.11.7", "torch": "2.13.0"}',129024,900,61.5,'{"success_rate": 0.97}','2026-11-25T08:45:05.586+00:00','2026-11-25T08:45:05.648+00:00',0);
INSERT INTO "runs" VALUES(2,'train','hdm','GapBall',NULL,'[]',1099511627777,'finished','{"frames": 130000, "hybrid": {"lanes": 64}}','{"python": "3.11.7", "torch": "2.13.0"}',129024,900,61.5,'{"success_rate": 0.97}','2026-11-25T08:45:05.680+00:00','2026-11-25T08:45:05.740+00:00',0);
INSERT INTO "runs" VALUES(3,'transfer','paddle','BlockedBoxUnlockPickup','A','["policy-1", "policy-2"]',3,'interrupted','{"frames": 60000}','{}',4096,7,2.0,'{}','2026-11-25T08:45:05.768+00:00','2026-11-25T08:45:05.800+00:00',0);
INSERT INTO "runs" VALUES(4,'train','hdm','BoxDoor',NULL,'[]',0,'running','{}','{}',0,0,0.0,'{}','2026-11-25T08:45:05.820+00:00',NULL,0);
CREATE INDEX ix_policies_run ON policies (run);
CREATE INDEX ix_policies_task ON policies (task);
DELETE FROM "sqlite_sequence";
INSERT INTO "sqlite_sequence" VALUES('runs',4);
INSERT INTO "sqlite_sequence" VALUES('policies',2);
COMMIT;
